"""Least squares over all horizons at once.

Each kind of error (channel and horizon) has its own unspecified scale: the cost is the logarithm of
its mean square, summed over the kinds, so that none dominates and no noise level is needed. Values
that a datasheet states with a tolerance have a Gaussian prior.

Where a joint is free to move, part of the cost is the same error expressed as the torque that would
have caused it. A joint of great inertia hardly responds to its input, but may still predict a
repetitive motion from the state alone. Expressed as torques, its errors are large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.candidates.number import STEP
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.windows import Windows
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.joint.kernel.arrays import Floats

LEAST = 3e-3
"""Relative error below which a better fit has no value."""
LONGEST = 3.0
"""Largest step of a fit, in units of a coordinate."""
MOTION, LISTEN, FORCE = "q_m", 0.1, 0.2
"""Channel and horizon of the error that also counts as a torque, and the weight of that; all
horizons together weigh one."""
LIGHT = 0.01
"""Least share of the usual torque that accelerates a real joint. A lighter one, held by dry
friction alone, gets no credit for responding better."""
ROUGH = 3
"""Stride of the windows used for a quick look at a candidate."""
FEWEST = 5
"""Fewest windows with motion that define the usual error."""
USUAL, BOUND = 0.8, 4.0
"""Quantile that defines a usual mean square, and the multiple of it beyond which a window counts
logarithmically."""
SHARES = {0.02: 0.5, 0.1: 1.0, 0.5: 1.0}
"""Weight of each horizon: the error of the shortest is mostly that of the measured start."""


SLOW = {"load_friction": 2.5, "presliding": 1.5, "spring_hysteresis": 1.5, "stribeck": 1.3}
"""Approximate ratios of the time of a simulation with and without an effect."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A model at its best-fit coordinates.

    Attributes:
        model: The model.
        z: Coordinates, shape (n,).
        cost: Minimised cost.
        errors: Errors by kind, each of shape (windows, points).
        jacobian: Derivatives of the errors by kind, each of shape (windows, points, n).
    """

    model: Model
    z: Floats
    cost: float
    errors: list[Floats]
    jacobian: list[Floats] | None = None

    def relative(self) -> Floats:
        """Return the relative error of each kind."""
        return np.sqrt([float(np.mean(e**2)) for e in self.errors])


def bounded(errors: Floats, moving: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return the contribution of each window and the weight of its errors, shape (W,) each.

    The few windows with very large errors (an impact, an end stop) count less than their square.
    Windows with motion are not treated as such outliers where a joint is mostly at rest.

    Args:
        errors: Errors of the windows, shape (W, points).
        moving: Windows with motion, shape (W,).
    """
    square = np.mean(errors**2, axis=1)
    usual = square[moving] if np.count_nonzero(moving) >= FEWEST else square
    bound = BOUND * float(np.quantile(usual, USUAL)) + LEAST**2
    return bound * np.log1p(square / bound), 1.0 / (1.0 + square / bound)


@dataclass(eq=False)
class Problem:
    """Windows to which models are fitted.

    Attributes:
        windows: The windows.
        work: Samples predicted so far, of each body that moves; more of slow models.
        force: Weight of an error as a torque.
        count: Number of windows that count as independent, against which tolerances weigh; by
            default all.
        weights: Weight of each kind; they sum to one.
    """

    windows: Windows
    work: int = 0
    force: float = 0.0
    count: int = 0

    def __post_init__(self) -> None:
        self._counting = Lock()
        keys = self.windows.keys
        shares = np.array([SHARES.get(horizon, 1.0) for _, horizon in keys])
        self.weights = shares / shares.sum()
        free = (MOTION, LISTEN) in keys and not any(h == WHOLE for _, h in keys)
        self.force = FORCE if free else 0.0
        self.count = self.count or self.windows.count
        self._least: float | None = None

    @property
    def strength(self) -> float:
        """Half the number of independent errors."""
        return 0.5 * self.count

    @property
    def all_work(self) -> int:
        """Samples predicted so far, including quick looks."""
        return self.work + self.rough.work

    @cached_property
    def rough(self) -> Problem:
        """The same problem with fewer windows, for a quick look."""
        few = Problem(self.windows.every(ROUGH))
        few.force = self.force
        return few

    def at(self, model: Model, z: Floats) -> Fit:
        """Return a model at given coordinates as a fit, with its derivatives."""
        errors = self.errors(model, z)
        jacobian = self.jacobian(model, z, errors)
        return Fit(model, z, self.cost(model, z, errors), errors, jacobian)

    def weight(self, key: tuple[str, float]) -> float:
        """Return the weight of a kind of error."""
        extra = self.force if key == (MOTION, LISTEN) else 0.0
        return float(self.weights[self.windows.keys.index(key)]) + extra

    def deafness(self, model: Model, z: Floats) -> float:
        """Return the logarithm of the torque that displaces a free joint by a given error."""
        if self._least is None:
            did = float(np.sqrt(self.windows.scales[self.windows.keys.index((MOTION, LISTEN))]))
            self._least = LIGHT * scales_of(model.joint, self.windows.logs).torque / did
        return float(np.log(resistance(model, z) + self._least))

    def _slopes(self, model: Model, z: Floats) -> Floats:
        """Return the derivatives of `deafness`, shape (n,)."""
        here = self.deafness(model, z)
        out = np.zeros(len(z))
        for j in range(len(z)):
            moved = z.copy()
            moved[j] += STEP
            out[j] = (self.deafness(model, moved) - here) / STEP
        return out

    def errors(self, model: Model, z: Floats) -> list[Floats]:
        """Return the errors of a model by kind."""
        with self._counting:  # the kernel's time grows with the bodies that move
            slow = prod(SLOW.get(term.name, 1.0) for term in model.terms)
            self.work += round(self.windows.samples * model.joint.structure_row.size * slow)
        try:
            return self.windows.errors(model.at(z))
        except (CjtGymError, np.linalg.LinAlgError, ValueError):
            return self.windows.lost

    def cost(self, model: Model, z: Floats, errors: Sequence[Floats]) -> float:
        """Return the cost of a model at coordinates."""
        kinds = zip(errors, self.windows.moving, strict=True)
        squares = np.array([float(np.mean(bounded(e, moving)[0])) for e, moving in kinds])
        logs = np.log(squares + LEAST**2)
        data = float(self.weights @ logs)
        if self.force:
            key = self.windows.keys.index((MOTION, LISTEN))
            data += self.force * (logs[key] + 2.0 * self.deafness(model, z))
        return self.strength * data + 0.5 * float(np.sum(z[_known(model)] ** 2))

    def scored(self, fit: Fit) -> Fit:
        """Return a fit to other windows with its errors and cost in these, without priors."""
        errors = self.errors(fit.model, fit.z)
        cost = self.cost(Model(fit.model.joint), np.zeros(0), errors)
        return Fit(fit.model, fit.z, cost, errors)

    def fit(self, model: Model, z: Floats | None = None, steps: int = 24) -> Fit:
        """Return the best fit of a model from given coordinates, by Levenberg-Marquardt.

        Between accepted steps the derivatives are updated by Broyden's rank-one formula, which
        costs no predictions; they are evaluated anew where a step gains little.
        """
        z = np.zeros(len(model.numbers)) if z is None else np.array(z, dtype=np.float64)
        errors = self.errors(model, z)
        cost, damping = self.cost(model, z, errors), 1e-3
        jacobian, exact = None, False
        for _ in range(steps if len(z) else 0):
            if jacobian is None:
                jacobian, exact = self.jacobian(model, z, errors), True
            hessian, gradient = self.normal(model, z, errors, jacobian)
            free = _free(model, z, gradient)
            gain, move, fresh = 0.0, np.zeros(len(z)), exact
            for _ in range(5 if fresh else 1):
                move[free] = -_solve(hessian[np.ix_(free, free)], damping, gradient[free])
                new = _within(model, z + move * min(1.0, LONGEST / max(np.abs(move).max(), 1e-12)))
                tried = self.errors(model, new)
                better = self.cost(model, new, tried)
                if better < cost:
                    jacobian, exact = _updated(jacobian, new - z, errors, tried), False
                    gain, cost, z, errors = cost - better, better, new, tried
                    damping = max(damping / 8.0, 1e-9)
                    break
                damping = max(damping * 8.0, 1e-3)
            if gain < 2e-3 * self.strength:
                if fresh:
                    break
                jacobian = None
        return Fit(model, z, cost, errors, jacobian)

    def jacobian(
        self,
        model: Model,
        z: Floats,
        errors: Sequence[Floats],
        first: int = 0,
        known: Sequence[Floats] | None = None,
        way: float = 1.0,
    ) -> list[Floats]:
        """Return the derivatives of the errors, each of shape (windows, points, n).

        Those of the first `first` numbers may be given as `known`. With a `way` of -1 the
        differences are taken towards smaller coordinates.
        """
        out = [np.zeros((*e.shape, len(z))) for e in errors]
        for k, columns in enumerate(known or ()):
            out[k][..., :first] = columns
        moves = []
        for j in range(first, len(z)):
            number = model.numbers[j]
            step = way * number.step
            if number.value(z[j] + step) >= number.high or number.value(z[j]) >= number.high:
                step = -step
            moved = z.copy()
            moved[j] += step
            moves.append((j, step, moved))
        tried = side_by_side(lambda move: self.errors(model, move[2]), moves)
        for (j, step, _), ahead in zip(moves, tried, strict=True):
            for k, e in enumerate(ahead):
                out[k][..., j] = (e - errors[k]) / step
        return out

    def normal(
        self, model: Model, z: Floats, errors: Sequence[Floats], jacobian: Sequence[Floats]
    ) -> tuple[Floats, Floats]:
        """Return the Gauss-Newton Hessian, shape (n, n), and the gradient, shape (n,)."""
        known = _known(model)
        hessian, gradient = np.diag(known + 1e-9), known * z
        weights = self.weights.copy()
        if self.force:
            weights[self.windows.keys.index((MOTION, LISTEN))] += self.force
            gradient = gradient + 2.0 * self.strength * self.force * self._slopes(model, z)
        moving = self.windows.moving
        for weight, e, j, moves in zip(weights, errors, jacobian, moving, strict=True):
            counted, share = bounded(e, moves)
            factor = 2.0 * self.strength * weight / (float(np.mean(counted)) + LEAST**2) / e.size
            flat = (j * share[:, None, None]).reshape(-1, len(z))
            hessian = hessian + factor * (flat.T @ j.reshape(-1, len(z)))
            gradient = gradient + factor * (flat.T @ e.reshape(-1))
        return hessian, gradient


def resistance(model: Model, z: Floats) -> float:
    """Return the torque that displaces a free joint by a given error [N m/rad].

    Over a time h it is about 2 I / h^2 + d / h for inertia I and damping d, divided by the relative
    torque constant and by the share of the torque that load-dependent friction leaves.
    """
    draft = model.draft(z)
    p, shape = model.joint.parameters, model.joint.structure_row
    free = [b for b, g in zip("mgl", shape.groups, strict=True) if g >= 0]
    rows = draft.effects
    own = {**rows.get("inertia", {}), **rows.get("load_inertia", {}), **rows.get("damping", {})}
    inertia = sum(_number(own.get(f"I_{b}", p.get(f"I_{b}", 0.0))) for b in free)
    damping = sum(_number(own.get(f"d_{b}", p.get(f"d_{b}", 0.0))) for b in free)
    names = {term.name for term in model.terms}
    constant = _number(rows.get("torque_constant", {}).get("k_t", p.k_t)) / p.k_t
    lost = rows.get("load_friction", {}) if "load_friction" in names else {}
    heard = constant * (1.0 - sum(_number(lost.get(f"mu_{b}", 0.0)) for b in free))
    size = 2.0 * inertia / LISTEN**2 + damping / LISTEN
    return size / max(heard, LEAST)


def _number(value: object) -> float:
    return float(value)  # type: ignore[arg-type]


def _updated(
    jacobian: Sequence[Floats], move: Floats, before: Sequence[Floats], after: Sequence[Floats]
) -> list[Floats]:
    """Return derivatives that agree with the change of the errors along a step."""
    along = move / max(float(move @ move), 1e-300)
    return [
        j + (new - old - j @ move)[..., None] * along
        for j, old, new in zip(jacobian, before, after, strict=True)
    ]


def _known(model: Model) -> Floats:
    return np.array([float(n.prior) for n in model.numbers], dtype=bool)


def _solve(hessian: Floats, damping: float, gradient: Floats) -> Floats:
    matrix = hessian + np.diag(damping * np.diag(hessian) + 1e-12)
    return np.asarray(np.linalg.lstsq(matrix, gradient, rcond=None)[0])


def _free(model: Model, z: Floats, gradient: Floats) -> NDArray[np.bool_]:
    """Return which numbers may move: all but those held back by their bounds."""
    values = np.array([n.value(float(x)) for n, x in zip(model.numbers, z, strict=True)])
    low, high = (np.array([getattr(n, end) for n in model.numbers]) for end in ("low", "high"))
    return ~(((values <= low) & (gradient > 0.0)) | ((values >= high) & (gradient < 0.0)))


def _within(model: Model, z: Floats) -> Floats:
    """Return coordinates with their values clipped to their bounds."""
    return np.array(
        [n.coordinate(n.value(float(x))) for n, x in zip(model.numbers, z, strict=True)]
    )
