"""Fitting a model: datasheet values, offsets and effects, by their concentrated likelihood.

The cost of a model is sum over stages of N/10 log(mean square) + |z|^2/2, where z are the
coordinates of its numbers (prior N(0, 1)). The factor 10, where white Gaussian residuals would have
2, pays for residuals that are never quite white. Steps are those of Levenberg and Marquardt with
the weights that the logarithm implies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.candidates.nuisances import Nuisance, nuisances, nuisances_of_others
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.process import settle_noise
from cjt_gym.joint.kernel.arrays import Floats

DEFLATION = 10.0
FLOOR = 1.05
"""Rms of a normalised residual below which lowering it further is no improvement."""
STEP = 1e-3
MOVES = 12
STRAINED, RELAXED = 3.0, 0.5
"""Deviations from the datasheet above which a value is strained, and to which it is relaxed."""
LONGEST = 100.0
"""Longest step of a coordinate."""
RUNAWAY = 1e30
"""Sum of squares of a derivative from which a model runs away; it then tells no direction."""


@dataclass(frozen=True)
class Model:
    """A set of effects that are assumed to act."""

    effects: tuple[Candidate, ...] = ()

    def without(self, index: int) -> Model:
        """Return the model without one of its effects."""
        return Model(self.effects[:index] + self.effects[index + 1 :])

    def fields(self, base: Fields, shared: Sequence[Nuisance], z: Floats) -> Fields:
        """Return the fields at coordinates z: first the nuisances', then each effect's."""
        fields = dict(base)
        for nuisance, value in zip(shared, z, strict=False):
            nuisance.put(fields, base, value)
        at = len(shared)
        for effect in self.effects:
            values = {}
            for unknown in effect.unknowns:
                values[unknown.symbol] = unknown.value(z[at])
                at += 1
            effect.apply(fields, values)
        return fields


@dataclass(eq=False)
class Fit:
    """A fitted model."""

    model: Model  # what was fitted
    z: Floats  # coordinates of nuisances, then effects, shape (p,)
    cost: float  # its cost
    mean_square: dict[str, float]  # mean square of each stage's normalised residual
    residuals: dict[str, Floats]  # normalised residuals by stage
    # derivatives of each stage's residual, shape (N, p), if they were computed
    jacobian: dict[str, Floats] = field(default_factory=dict)


@dataclass(eq=False)
class Problem:
    """Everything needed to fit any model to one record."""

    stages: Stages  # the record's stages, tuned
    shared: tuple[Nuisance, ...] = ()  # nuisances
    counts: dict[str, int] = field(default_factory=dict)  # number of samples that count, by stage
    # mean square below which lowering a residual is no improvement, by stage, where it is another
    # than that of noise as it is stated or allowed for
    floors: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, stages: Stages) -> Problem:
        """Return the problem of a record; its predictors are tuned to the nominal joint."""
        shared = nuisances(stages.setting, stages.names)
        others = [(other.setting, other.names) for other in stages.others]
        problem = cls(stages, shared + nuisances_of_others(shared, others))
        fields = problem.fields(Model(), np.zeros(len(problem.shared)))
        if stages.setting.current_unspecified and stages.setting.process == 0.0:
            settle_noise(stages, fields)
        stages.tune(fields)
        problem.counts = {name: stages.count(name) for name in stages.names}
        return problem

    # ---- the model as a function of its coordinates
    def unknowns(self, model: Model) -> list[Number]:
        """Return all numbers of a model in the order of its coordinates."""
        found = [n.unknown for n in self.shared]
        return found + [u for effect in model.effects for u in effect.unknowns]

    def span(self, model: Model, index: int) -> slice:
        """Return the slice of an effect's coordinates."""
        at = len(self.shared) + sum(len(e.unknowns) for e in model.effects[:index])
        return slice(at, at + len(model.effects[index].unknowns))

    def values(self, model: Model, z: Floats, index: int) -> dict[str, float]:
        """Return the numbers of an effect by their symbols."""
        pairs = zip(model.effects[index].unknowns, z[self.span(model, index)], strict=True)
        return {unknown.symbol: unknown.value(float(x)) for unknown, x in pairs}

    def touches(self, model: Model) -> list[tuple[str, ...]]:
        """Return the stages that each coordinate changes, of those that the record shows."""
        found = [n.stages for n in self.shared]
        found += [effect.touches for effect in model.effects for _ in effect.unknowns]
        return [tuple(n for n in stages if n in self.stages.names) for stages in found]

    def fields(self, model: Model, z: Floats) -> Fields:
        """Return the fields of a model."""
        return model.fields(self.stages.setting.nominal, self.shared, z)

    def residuals(
        self, model: Model, z: Floats, names: Sequence[str] | None = None
    ) -> dict[str, Floats]:
        """Return normalised residuals by stage."""
        fields = self.fields(model, z)
        wanted = self.stages.names if names is None else names
        return {name: self.stages.residual(name, fields) for name in wanted}

    def mean_square(self, residuals: dict[str, Floats]) -> dict[str, float]:
        """Return the mean square of each stage's residual."""
        return {n: float(r @ r) / max(self.counts[n], 1) for n, r in residuals.items()}

    def floor(self, stage: str) -> float:
        """Return the mean square of a stage's residual from which lowering it is no improvement."""
        return self.floors.get(stage, FLOOR**2)

    def has_prior(self, model: Model) -> NDArray[np.bool_]:
        """Return which coordinates of a model have a prior, shape (p,)."""
        return np.array([u.prior for u in self.unknowns(model)], dtype=bool)

    def strain(self, z: Floats) -> float:
        """Return the cost of the priors of datasheet values and offsets."""
        return 0.5 * float(np.sum(z[: len(self.shared)][self.has_prior(Model())] ** 2))

    def cost(
        self, model: Model, mean_square: dict[str, float], z: Floats, below: bool = True
    ) -> float:
        """Return the cost of a fit.

        Args:
            model: The model.
            mean_square: Mean square of each stage's residual.
            z: Coordinates, shape (p,).
            below: Whether residuals below the floor still lower the cost, then only linearly.
        """
        total = 0.5 * float(np.sum(z[self.has_prior(model)] ** 2))
        for name, ms in mean_square.items():
            if not np.isfinite(ms):
                return np.inf
            ratio = ms / self.floor(name)
            excess = np.log(ratio) if ratio > 1 else ratio - 1 if below else 0.0
            total += self.counts[name] / DEFLATION * excess
        return float(total)

    def bounded(self, model: Model, z: Floats) -> Floats:
        """Return coordinates with those beyond a bound moved to it, shape (p,)."""
        for j, unknown in enumerate(self.unknowns(model)):
            if unknown.at_bound(z[j]):
                z[j] = unknown.coordinate(unknown.value(z[j]))
        return z

    # ---- fitting
    def fit(
        self,
        model: Model,
        z: Floats,
        moves: int = MOVES,
        known: dict[str, Floats] | None = None,
        tolerance: float = 0.1,
        bends: bool = False,
    ) -> Fit:
        """Return the model fitted from the coordinates z.

        Args:
            model: The effects.
            z: Start, shape (p,).
            moves: Largest number of steps.
            known: Derivatives for the first numbers, from a similar fit, shape (N, some) by stage.
            tolerance: Gain in cost below which the fit ends.
            bends: Whether a step that leaves a bending valley of the cost is led back into it.
        """
        z = z.copy()
        residuals = self.residuals(model, z)
        ms = self.mean_square(residuals)
        cost = self.cost(model, ms, z)
        if not np.isfinite(cost):  # a model that runs away from where it starts
            return Fit(model, z, np.inf, ms, residuals, known or {})
        jacobian = self.jacobian(model, z, residuals, known)
        fresh, damping = known is None, 1e-3
        for _ in range(moves if z.size else 0):
            near = self._linearised(model, jacobian, ms)
            gain, damping, step = self._search(near, z, residuals, cost, damping, bends)
            if step is not None:
                z, residuals, ms, cost = step
            small = step is None or gain < tolerance
            if small and fresh:
                break
            fresh = small  # nuisances' derivatives are renewed only once the old ones fail
            jacobian = self.jacobian(model, z, residuals, None if small else jacobian)
        fitted = Fit(model, z, cost, ms, residuals, jacobian)
        return self._relaxed(fitted) if moves else fitted

    def from_datasheet(self, fit: Fit, moves: int, tolerance: float) -> Fit:
        """Return the better one of a fit and one that starts where the datasheet is not strained.

        A datasheet value that an effect sets free may have strained others before it was free, and
        on the narrow way back along a valley of the cost a fit ends early.
        """
        known = len(self.shared)
        z = np.r_[np.zeros(known), fit.z[known:]]
        other = self.fit(fit.model, z, moves, tolerance=tolerance, bends=True)
        costs = [self.cost(fit.model, one.mean_square, one.z, False) for one in (fit, other)]
        return other if costs[1] < costs[0] else fit

    def _relaxed(self, fit: Fit) -> Fit:
        """Return a fit without datasheet strain that merely lowers residuals below the floor.

        A lower residual is no improvement there: a body held by friction scatters less than a
        free one, and a heavier body less still.
        """
        model = fit.model
        for j, nuisance in enumerate(self.shared):
            if not nuisance.unknown.prior or abs(fit.z[j]) <= STRAINED:
                continue
            z = fit.z.copy()
            z[j] = np.clip(z[j], -RELAXED, RELAXED)
            residuals = fit.residuals | self.residuals(model, z, nuisance.stages)
            ms = self.mean_square(residuals)
            if self.cost(model, ms, z, False) < self.cost(model, fit.mean_square, fit.z, False):
                cost = self.cost(model, ms, z)
                fit = replace(fit, z=z, cost=cost, mean_square=ms, residuals=residuals)
        return fit

    def _search(
        self,
        near: _Linearised,
        z: Floats,
        residuals: dict[str, Floats],
        cost: float,
        damping: float,
        bends: bool,
    ) -> tuple[float, float, tuple[Floats, dict[str, Floats], dict[str, float], float] | None]:
        hessian, gradient = near.hessian, near.gradient(residuals, z)
        diagonal = np.diag(hessian).copy()
        for _ in range(6):
            matrix = hessian + np.diag(damping * diagonal + 1e-12)
            move = -np.linalg.solve(matrix, gradient)
            move = move * min(1.0, LONGEST / max(float(np.abs(move).max()), 1e-12))
            new = self.bounded(near.model, z + move)
            there = self.residuals(near.model, new)
            for back in (False, True) if bends else (False,):
                if back:
                    move = -np.linalg.solve(matrix, near.gradient(there, new))
                    new = self.bounded(near.model, new + move)
                    there = self.residuals(near.model, new)
                ms = self.mean_square(there)
                better = self.cost(near.model, ms, new)
                if better < cost:
                    return cost - better, max(damping / 10.0, 1e-9), (new, there, ms, better)
                if not np.isfinite(better):
                    break
            damping = max(damping * 10.0, 1e-3)
        return 0.0, damping, None

    def jacobian(
        self,
        model: Model,
        z: Floats,
        residuals: dict[str, Floats],
        known: dict[str, Floats] | None = None,
        *,
        central: bool = False,
    ) -> dict[str, Floats]:
        """Return the derivatives of the residuals by differences, shape (N, p) by stage.

        If some are already known, only those of the effects are computed. Central differences take
        twice as long: where all torques change by one factor, what each of them does must cancel.
        """
        size, first = len(z), 0
        out = {name: np.zeros((len(r), size), order="F") for name, r in residuals.items()}
        if known is not None:
            first = len(self.shared)
            for name, columns in known.items():
                out[name][:, :first] = columns[:, :first]
        unknowns, touches = self.unknowns(model), self.touches(model)

        def column(j: int) -> None:
            step = difference(unknowns[j], z[j])
            moved = z.copy()
            moved[j] += step
            ahead, back, width = self.residuals(model, moved, touches[j]), residuals, step
            if central and not unknowns[j].at_bound(z[j] - step):
                moved[j] -= 2.0 * step
                back, width = self.residuals(model, moved, touches[j]), 2.0 * step
            for name, r in ahead.items():
                slope = (r - back[name]) / width
                if slope @ slope < RUNAWAY:
                    out[name][:, j] = slope

        side_by_side(column, range(first, size))
        return out

    def _linearised(
        self, model: Model, jacobian: dict[str, Floats], ms: dict[str, float]
    ) -> _Linearised:
        weights = {n: 2.0 / DEFLATION / max(ms[n], self.floor(n)) for n in jacobian}
        prior = self.has_prior(model).astype(np.float64)
        return _Linearised(model, jacobian, weights, prior)


@dataclass(frozen=True)
class _Linearised:
    """The cost near some coordinates, with residuals that change linearly."""

    model: Model
    jacobian: dict[str, Floats]  # derivatives of the residuals, shape (N, p) by stage
    weights: dict[str, float]  # weight of a squared residual, by stage
    prior: Floats  # 1 for the coordinates that have a prior, 0 for others, shape (p,)

    @property
    def hessian(self) -> Floats:
        """Second derivatives of the cost, shape (p, p)."""
        parts = (w * (self.jacobian[n].T @ self.jacobian[n]) for n, w in self.weights.items())
        return np.asarray(sum(parts, np.diag(self.prior + 1e-9)))

    def gradient(self, residuals: dict[str, Floats], z: Floats) -> Floats:
        """Return the derivatives of the cost at coordinates with these residuals, shape (p,)."""
        parts = (w * (self.jacobian[n].T @ residuals[n]) for n, w in self.weights.items())
        return np.asarray(sum(parts, self.prior * z))


def difference(unknown: Number, z: float) -> float:
    """Return the step of a finite difference, away from a bound."""
    return -STEP if unknown.at_bound(z + STEP) else STEP


def retuned(problem: Problem, fit: Fit) -> Fit:
    """Tune the predictors to a fitted model and fit it again."""
    problem.stages.tune(problem.fields(fit.model, fit.z))
    return problem.fit(fit.model, fit.z)


def without(problem: Problem, fit: Fit, index: int) -> Fit:
    """Return the fit of a model without one of its effects."""
    z = np.delete(fit.z, problem.span(fit.model, index))
    return problem.fit(fit.model.without(index), z, known=fit.jacobian)
