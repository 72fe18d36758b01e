"""Uncertainty of a fit's numbers, from the scatter of its gradient over pieces of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.horizons.fitting.base_terms import INERTIA
from cjt_gym.gap.horizons.fitting.datasheet import inertias_at
from cjt_gym.gap.horizons.fitting.fit import LEAST, Fit, Problem, bounded
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.recorded.tolerances import GUESSED, stated, tolerance_of
from cjt_gym.gap.stages.intervals import at_known, is_there, known_to_a_factor
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.kernel.arrays import Floats

INTERVAL = 0.95
BENT = 0.05
"""Difference between the slopes to either side, relative to the larger or the usual one, from
which a window jumps. Of smooth ones most differ by 0.002."""
SCALED = frozenset({"N m", "N m s/rad", "N m/rad", "N m/rad^3", "kg m^2"})
"""Units of the numbers that are in proportion to the torque of a motor."""
USUAL = 0.1
"""Relative tolerance of a resistance that states none: copper warms by 25 K for a tenth."""
ROUNDING = 0.01
"""Share that differences of large numbers leave in most windows where they should cancel. In those
in which a joint sticks they leave more: 0.02 of all windows of a torsion rig, which halved and
quartered its intervals."""
KEPT = 0.2
"""Share of the windows, the least bent ones, that determine values even if all of them jump."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Covariance of the coordinates of a fit.

    Attributes:
        fit: The fit.
        matrix: Covariance, shape (n, n).
        factor: Half width of an interval, in standard deviations.
        known: Covariance if the scale of all torques were known, shape (n, n).
        sheet: What the datasheet tells of each coordinate, as an inverse variance, shape (n,); by
            default that of its prior.
    """

    fit: Fit
    matrix: Floats
    factor: float
    known: Floats
    sheet: Floats | None = None

    @property
    def at_scale(self) -> Spread:
        """The spread if the scale of all torques were known."""
        return replace(self, matrix=self.known)

    def wider(self, by: float) -> Spread:
        """Return a spread whose part that the record determines is wider by a factor.

        What the datasheet tells of a number stays as sure as it was.
        """
        told = _known(self.fit.model) if self.sheet is None else self.sheet
        stated = np.diag(told) * (by**2 - 1.0)

        def wide(matrix: Floats) -> Floats:
            found = by**2 * matrix @ np.linalg.inv(np.eye(len(matrix)) + stated @ matrix)
            return np.asarray(0.5 * (found + found.T))

        return replace(self, matrix=wide(self.matrix), known=wide(self.known))

    @property
    def model(self) -> Model:
        """The model that was fitted."""
        return self.fit.model

    def intervals(self, index: int) -> dict[str, Interval]:
        """Return the numbers of a term with their 95 % intervals."""
        term, span = self.model.terms[index], self.model.span(index)
        found = {}
        for number, at in zip(term.numbers, range(span.start, span.stop), strict=True):
            half = self.factor * float(np.sqrt(max(self.matrix[at, at], 0.0)))
            z = float(self.fit.z[at])
            ends = sorted(self.stated(term, number.value(z + s * half)) for s in (-1.0, 1.0))
            value = self.stated(term, number.value(z))
            own = self.factor * float(np.sqrt(max(self.known[at, at], 0.0)))
            if number.unit in SCALED and not number.log:
                wide, narrow = (x * number.scale for x in (half, own))
                ends = known_to_a_factor(value, wide) if is_there(value, wide, narrow) else ends
            found[number.symbol] = Interval(value, ends[0], ends[1], self._unit(term, number))
        return found

    def stated(self, term: Term, value: float) -> float:
        """Return a fitted number as a joint file states it: the rotor's inertia, not a factor."""
        if term.name != "inertia":
            return value
        return inertias_at(self.model.joint, value)["I_m"]

    def _unit(self, term: Term, number: Number) -> str:
        """Return the unit of a number for the joint; N instead of N m if prismatic."""
        parameter = EFFECTS[term.name].parameter(number.symbol)
        if parameter is None:
            return number.unit
        return unit_on(parameter, self.model.joint.parameters)


def spread_of(problem: Problem, fit: Fit) -> Spread:
    """Return the "sandwich" covariance of a fit: curvature corrected by its gradient's scatter.

    Each piece of the record counts as one observation, so that correlated errors within a piece do
    not make the numbers look more certain than they are.
    """
    jacobian, logs = _slopes(problem, fit), problem.windows.logs
    felt = any("tau" in log.measured or np.any(log.load) for log in logs)
    if not felt:
        jacobian = _blind(jacobian, fit, _way(fit, voltage=logs[0].voltage))
    hessian, _ = problem.normal(fit.model, fit.z, fit.errors, jacobian)
    held, known = np.array([n.prior for n in fit.model.numbers], dtype=float), _known(fit.model)
    hessian += np.diag(known - held)
    size = max(int(problem.windows.pieces(k).max()) for k in problem.windows.keys) + 1
    scores, there = np.zeros((size, len(fit.z))), np.zeros(size, dtype=bool)
    moving = problem.windows.moving
    for key, e, j, moves in zip(problem.windows.keys, fit.errors, jacobian, moving, strict=True):
        amount, share = bounded(e, moves)
        factor = 2.0 * problem.strength * problem.weight(key)
        factor /= (float(np.mean(amount)) + LEAST**2) * e.size
        each = factor * np.einsum("wp,wpn->wn", e * share[:, None], j)
        pieces = problem.windows.pieces(key)
        np.add.at(scores, pieces, each)
        there[pieces] = True
    scores = scores[there]
    count = len(scores)
    middle = scores.T @ scores * count / max(count - 1, 1) + np.diag(known)
    inverse = np.linalg.pinv(hessian)
    factor = float(student.ppf(0.5 + 0.5 * INTERVAL, max(count - 1, 1)))
    matrix = inverse @ middle @ inverse
    scales = [k for k, n in enumerate(fit.model.numbers) if n.symbol == "k_t"]
    alone = at_known(matrix, scales)
    if scales_of(fit.model.joint, logs).coasts:
        way, spread = _way(fit, voltage=False), _inertia_spread(fit.model.joint)
        matrix += np.outer(way, way) * spread**2
        own = [t.name for t in fit.model.terms].index("inertia")
        known[fit.model.span(own)] = (fit.model.terms[own].numbers[0].scale / spread) ** 2
    elif not felt:
        matrix += _of_scale(fit, voltage=logs[0].voltage)
    return Spread(fit, matrix, factor, alone, known)


def _known(model: Model) -> Floats:
    """Return what the datasheet tells of each coordinate, as an inverse variance, shape (n,).

    That a last fit holds the inertia near where a search left it tells nothing.
    """
    known = np.array([float(n.prior) for n in model.numbers])
    for index, term in enumerate(model.terms):
        if term.loose is not None:
            ratio = term.numbers[0].scale / term.loose.scale
            known[model.span(index).start] = float(term.loose.prior) * ratio**2
    return known


def _of_scale(fit: Fit, *, voltage: bool) -> Floats:
    """Return the covariance that one common ratio of all torques adds where none is measured.

    A voltage v = r / (k_t n) torque + k_t n speed leaves open how large r is if inertia, friction
    and weight are smaller in proportion; so does a current with its torque constant. Only
    tolerances limit that, among them that of a listed weight, which a fit without it takes as
    given.
    """
    model, numbers = fit.model, fit.model.numbers
    own = {term.name for term in model.terms}
    weight = None if "gravity" in own else stated(model.joint.file, "gravity", "torque")
    listed = weight is not None and "gravity" in model.joint.effects
    weighed = (weight.tolerance or USUAL) ** -2 if weight is not None and listed else 0.0
    known = 0.0
    if voltage and "r" in model.joint.parameters:
        known = weighed + min(tolerance_of(model.joint.file, "r", USUAL), GUESSED) ** -2
    elif not voltage and "torque_constant" in own:
        known = weighed
    if known <= 0.0:
        return np.zeros((len(numbers), len(numbers)))
    way = _way(fit, voltage=voltage)
    known += sum(x**2 for x, number in zip(way, numbers, strict=True) if number.prior)
    return np.asarray(np.outer(way, way) / known)


def _inertia_spread(joint: Joint) -> float:
    """Return the relative deviation of the datasheet's inertia, of all that moves with the motor.

    Where nothing drives the joint, friction and weight show in proportion to the inertia, which a
    fit takes as stated.
    """
    own = {s: joint.parameters.get(s, 0.0) for s in inertias_at(joint, 1.0)}
    off = [min(tolerance_of(joint.file, s, INERTIA), GUESSED) * x for s, x in own.items()]
    return max(float(np.linalg.norm(off)) / sum(own.values()), LEAST**2)


def _way(fit: Fit, *, voltage: bool) -> Floats:
    """Return how the coordinates change if all torques grow by one factor e, shape (n,)."""
    way = np.zeros(len(fit.model.numbers))
    for index, term in enumerate(fit.model.terms):
        for at, number in enumerate(term.numbers, fit.model.span(index).start):
            scales = term.name == "inertia" or number.unit in SCALED
            if scales or (not voltage and term.name == "torque_constant"):
                value = 1.0 if number.log else number.value(float(fit.z[at]))
                way[at] = value / number.scale
    return way


def _blind(jacobian: Sequence[Floats], fit: Fit, way: Floats) -> list[Floats]:
    """Return derivatives that tell nothing of a common scale, if most windows tell nothing of it.

    What the torque constant does must then cancel what the other torques do, all of them large.
    """
    constant = [k for k, n in enumerate(fit.model.numbers) if n.symbol == "k_t" and way[k]]
    told = np.concatenate([np.linalg.norm(j @ way, axis=1) for j in jacobian])
    parts = np.concatenate([np.linalg.norm(j * way, axis=(1, 2)) for j in jacobian])
    counts = parts > 0.0
    if len(constant) != 1 or not counts.any():
        return list(jacobian)
    if float(np.median(told[counts] / parts[counts])) > ROUNDING:  # a listed torque is a measure
        return list(jacobian)
    (at,), found = constant, []
    for j in jacobian:
        without = j.copy()
        without[..., at] -= (j @ way) / way[at]
        found.append(without)
    return found


def _slopes(problem: Problem, fit: Fit) -> list[Floats]:
    """Return the derivatives of the errors, none in windows whose differences are no slopes.

    A joint that sticks, or breaks away, on one side of a value alone makes a jump of a window,
    which as a slope would claim that the record determines the value far better than it does.
    """
    up, down = (problem.jacobian(fit.model, fit.z, fit.errors, way=way) for way in (1.0, -1.0))
    slopes = []
    for ahead, behind in zip(up, down, strict=True):
        size = np.maximum(np.abs(ahead), np.abs(behind)).max(axis=1)
        usual = np.maximum(np.maximum(size, np.median(size, axis=0)), LEAST**2)
        bend = (np.abs(ahead - behind).max(axis=1) / usual).max(axis=1)
        kept = counted(bend)[:, None, None]
        slopes.append(np.where(kept, 0.5 * (ahead + behind), 0.0))
    return slopes


def counted(bend: Floats) -> NDArray[np.bool_]:
    """Return the windows that determine values: those that do not jump, or the least bent ones.

    Args:
        bend: Relative difference of the slopes of each window to either side, shape (W,).
    """
    return bend <= max(BENT, float(np.quantile(bend, KEPT)))
