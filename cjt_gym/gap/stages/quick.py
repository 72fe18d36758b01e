"""A quick evaluation of one more effect: only its own derivatives are computed.

For one record and one fitted model the derivatives of all residuals with respect to the numbers of
that model are computed once. A candidate then costs one run of the stages that it touches per
starting point and number; the rest is algebra on sums of squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.stages.fit import DEFLATION, LONGEST, Fit, Model, Problem, difference
from cjt_gym.joint.kernel.arrays import Floats

RELINEARISED = 3
STRAINED = 3.0
"""Deviation of a datasheet value, in tolerances, that an effect may take over."""
TORQUES = ("N m", "N")
"""Units of numbers that grow with all other torques."""
MOVED = 1.0
"""Step of a coordinate above which the stages it changes are computed, not extrapolated."""


@dataclass(eq=False)
class Square:
    """A sum of squares as a function of a small step: ss + 2 g.d + d.H d."""

    ss: float
    g: Floats
    h: Floats

    def at(self, d: Floats) -> float:
        """Return the sum of squares after a step."""
        return float(self.ss + 2.0 * self.g @ d + d @ self.h @ d)


@dataclass(eq=False)
class Look:
    """The point from which candidates are judged: a fit with the derivatives of its residuals."""

    problem: Problem
    fit: Fit
    _products: dict[str, Floats] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._products = {n: j.T @ j for n, j in self.fit.jacobian.items()}

    def first(self, effect: Candidate, starts: tuple[tuple[float, ...], ...]) -> Fit | None:
        """Return the best fit after one step from each of an effect's starts."""
        steps = []
        for start in starts:
            e = [u.coordinate(x) for u, x in zip(effect.unknowns, start, strict=True)]
            steps.append(self._improve(effect, np.concatenate([self.fit.z, e])))
        for other in (self._relieved(effect), self._rescaled(effect)):
            if other is not None:
                steps.append(self._improve(effect, other))
        if not steps:
            return None
        return self._as_fit(effect, min(steps, key=lambda pair: pair[0])[1])

    def _relieved(self, effect: Candidate) -> Floats | None:
        """Return the same point with a strained datasheet value taken over by its effect, if any.

        A step along derivatives would not get there: the value is far off on a logarithmic scale.
        """
        fields = [nuisance.field for nuisance in self.problem.shared]
        if effect.releases not in fields or len(effect.unknowns) != 1:
            return None
        k, unknown = fields.index(effect.releases), effect.unknowns[0]
        if abs(self.fit.z[k]) < STRAINED:
            return None
        z = self.fit.z.copy()
        nominal = self.problem.stages.setting.nominal[effect.releases]
        excess = self.problem.shared[k].unknown.value(float(z[k])) - nominal
        z[k] = 0.0
        return np.append(z, unknown.coordinate(unknown.start + excess))

    def _rescaled(self, effect: Candidate) -> Floats | None:
        """Return the datasheet with a listed law in place of a strained torque constant, if any.

        What a law that is listed too small lacks, all other torques give up if they can.
        """
        shared, setting = self.problem.shared, self.problem.stages.setting
        fields = [nuisance.field for nuisance in shared]
        if not effect.listed or "k_t" not in fields:
            return None
        k = fields.index("k_t")
        if abs(self.fit.z[k]) < STRAINED:
            return None
        ratio = setting.nominal["k_t"] / shared[k].unknown.value(float(self.fit.z[k]))
        z = self.fit.z.copy()
        stated = [field in setting.joint.parameters.quantities for field in fields]
        z[: len(fields)][stated] = 0.0
        numbers = zip(effect.unknowns, effect.listed, strict=True)
        own = [u.coordinate(ratio * x if u.unit in TORQUES else x) for u, x in numbers]
        return np.concatenate([z, own])

    def refine(self, rough: Fit) -> Fit:
        """Return the fit of `first` after a few more steps."""
        effect, best = rough.model.effects[-1], (rough.cost, rough.z)
        for _ in range(RELINEARISED):
            found = self._improve(effect, best[1])
            small = found[0] > best[0] - 0.5
            best = min(best, found, key=lambda pair: pair[0])
            if small:
                break
        return self._as_fit(effect, best[1])

    def _with(self, effect: Candidate) -> Model:
        return Model((*self.fit.model.effects, effect))

    def _as_fit(self, effect: Candidate, z: Floats) -> Fit:
        model = self._with(effect)
        residuals = self.problem.residuals(model, z)
        ms = self.problem.mean_square(residuals)
        return Fit(model, z, self.problem.cost(model, ms, z), ms, residuals)

    def _improve(self, effect: Candidate, z: Floats) -> tuple[float, Floats]:
        """Return the cost and the coordinates after one step from z, with the cost checked."""
        squares, model = self._squares(effect, z), self._with(effect)
        here = self._cost(model, {n: s.ss for n, s in squares.items()}, z)
        move = self._solve(model, squares, z)
        for shrink in (1.0, 0.3, 0.1):
            new = self.problem.bounded(model, z + shrink * move)
            cost = self._checked(model, squares, z, new)
            if cost < here:
                return cost, new
        return here, z

    def _checked(self, model: Model, squares: dict[str, Square], z: Floats, new: Floats) -> float:
        sums = {n: s.at(new - z) for n, s in squares.items()}
        far = np.abs(new - z) > MOVED
        moved = {n for j, names in enumerate(self.problem.touches(model)) if far[j] for n in names}
        moved |= set(model.effects[-1].touches)
        true = self.problem.residuals(model, new, [n for n in squares if n in moved])
        sums |= {n: float(r @ r) for n, r in true.items()}
        return self._cost(model, sums, new)

    def _cost(self, model: Model, sums: dict[str, float], z: Floats) -> float:
        ms = {n: ss / max(self.problem.counts[n], 1) for n, ss in sums.items()}
        return self.problem.cost(model, ms, z)

    def _squares(self, effect: Candidate, z: Floats) -> dict[str, Square]:
        """Return the sums of squares around z."""
        model, old, extra = self._with(effect), len(self.fit.z), len(effect.unknowns)
        shift = z[:old] - self.fit.z
        residuals = self.problem.residuals(model, z, effect.touches)
        columns = {n: np.zeros((len(r), extra)) for n, r in residuals.items()}
        for j, unknown in enumerate(effect.unknowns):
            step = difference(unknown, z[old + j])
            moved = z.copy()
            moved[old + j] += step
            for n, r in self.problem.residuals(model, moved, effect.touches).items():
                columns[n][:, j] = (r - residuals[n]) / step
        out = {}
        for n, jacobian in self.fit.jacobian.items():
            h = np.zeros((old + extra, old + extra))
            g = np.zeros(old + extra)
            h[:old, :old] = self._products[n]
            if n in residuals:
                r, c = residuals[n], columns[n]
                h[:old, old:] = jacobian.T @ c
                h[old:, :old] = h[:old, old:].T
                h[old:, old:] = c.T @ c
                g[:old], g[old:] = jacobian.T @ r, c.T @ r
                out[n] = Square(float(r @ r), g, h)
            else:
                r = self.fit.residuals[n]
                base = Square(float(r @ r), jacobian.T @ r, self._products[n])
                g[:old] = base.g + base.h @ shift
                out[n] = Square(base.at(shift), g, h)
        return out

    def _solve(self, model: Model, squares: dict[str, Square], z: Floats) -> Floats:
        """Return the step that lowers the cost most for linear residuals."""
        prior = self.problem.has_prior(model).astype(np.float64)
        move: Floats = np.zeros(len(z))
        cost = self._cost(model, {n: s.ss for n, s in squares.items()}, z)
        for _ in range(8):
            hessian, gradient = np.diag(prior + 1e-9), prior * z
            for n, s in squares.items():
                ms = s.at(move) / max(self.problem.counts[n], 1)
                weight = 2.0 / DEFLATION / max(ms, self.problem.floor(n))
                hessian = hessian + weight * s.h
                gradient = gradient + weight * s.g
            damped = hessian + np.diag(1e-6 * np.diag(hessian))
            new = np.asarray(-np.linalg.solve(damped, gradient), dtype=np.float64)
            new *= min(1.0, LONGEST / max(float(np.abs(new).max()), 1e-12))
            sums = {n: max(s.at(new), 0.0) for n, s in squares.items()}
            better = self._cost(model, sums, z + new)
            if better > cost - 0.01:
                break
            move, cost = new, better
        return move
