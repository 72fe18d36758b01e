"""Confidence intervals of the numbers: parameter covariance from blocks of residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.diagnosis import Interval
from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.joint.kernel.arrays import Floats

BLOCKS = 40
NORMAL = 1.96
TENFOLD = 10.0
"""Ratio of the ends of an interval above which a record leaves a value open, and the largest factor
to which a guess leaves the scale of all torques open."""
INFLATION = 2.0
"""Factor for model error, which the covariance of a fit cannot account for."""
EXACT, EXACT_SHAPE = 0.0025, 0.025
"""Smallest relative deviation, since laws are solved sample by sample: of a magnitude, and of a
number on a logarithmic scale that only shapes a law near its bend. Chosen with `INFLATION` for
nominal coverage of the intervals of blind cases (`benchmarks/calibrate.py`).
"""

MOSTLY = 2.0
"""Ratio of an interval's width to that beside a known scale of all torques from which it is mostly
that scale that is open."""
TORQUES = ("k_t", "r")
"""Datasheet values that all torques scale with."""


@dataclass(frozen=True)
class Covariance:
    """Covariance of a fit's coordinates.

    Attributes:
        curved: That of the curvature of the likelihood, shape (p, p).
        scattered: That of the scatter of its gradient, shape (p, p).
    """

    curved: Floats
    scattered: Floats

    @property
    def matrix(self) -> Floats:
        """The larger of the two for each coordinate, with a margin for model error, (p, p)."""
        ratio = np.diag(self.scattered) / np.diag(self.curved)
        grow = np.sqrt(np.maximum(ratio, 1.0)) * INFLATION
        return self.curved * np.outer(grow, grow)

    def std(self, index: int) -> float:
        """Return the standard deviation of a coordinate."""
        return self.std_along(np.eye(len(self.curved))[index])

    def std_along(self, direction: Floats) -> float:
        """Return the standard deviation of a sum of coordinates, with these weights, shape (p,).

        A few blocks may scatter too little by chance: the larger of the two deviations counts.
        """
        both = (float(direction @ one @ direction) for one in (self.curved, self.scattered))
        return float(INFLATION * np.sqrt(max(*both, 0.0)))


def covariance(problem: Problem, fit: Fit) -> Covariance:
    """Return the covariance of a fit.

    Inverse curvature of the likelihood with the residuals' own mean square, corrected ("sandwich")
    by the scatter of its gradient between blocks, which also accounts for coloured residuals.
    """
    jacobian = problem.jacobian(fit.model, fit.z, fit.residuals, central=True)
    prior = np.diag(np.where(problem.has_prior(fit.model), 1.0, 1e-9))
    curvature, scatter = prior.copy(), prior.copy()
    for name, j in jacobian.items():
        weight = 1.0 / max(fit.mean_square[name], 1.0)
        curvature += weight * (j.T @ j)
        pieces = np.array_split(j * fit.residuals[name][:, None], BLOCKS)
        sums = np.array([piece.sum(axis=0) for piece in pieces]) * weight
        scatter += sums.T @ sums
    scale = 1.0 / np.sqrt(np.diag(curvature))  # for the inversion: columns differ greatly in size
    inverse = np.linalg.inv(curvature * np.outer(scale, scale)) * np.outer(scale, scale)
    return Covariance(inverse, inverse @ scatter @ inverse)


def effect_intervals(
    problem: Problem, fit: Fit, index: int, spread: Covariance
) -> dict[str, Interval]:
    """Return the numbers of one effect of a fit with their 95 % intervals."""
    effects, at = fit.model.effects, problem.span(fit.model, index).start
    slides = problem.stages.setting.joint.parameters.axis == "prismatic"
    scales = [j for j, n in enumerate(problem.shared) if n.field in TORQUES]
    alone, out = np.sqrt(np.maximum(np.diag(at_known(spread.matrix, scales)), 0.0)), {}
    for k, unknown in enumerate(effects[index].unknowns):
        z = fit.z[at + k]
        value = unknown.value(z)
        std = max(spread.std(at + k), _least(unknown, value))
        ends = sorted((unknown.value(z - NORMAL * std), unknown.value(z + NORMAL * std)))
        half, own = (NORMAL * float(x) * unknown.scale for x in (std, alone[at + k]))
        if not unknown.log and is_there(value, half, own):
            ends = known_to_a_factor(value, half)
        unit = along(unknown.unit) if slides else unknown.unit
        out[unknown.symbol] = Interval(value, ends[0], ends[1], unit)
    released = effects[index].releases
    if released is not None and released in out:
        out[released] = _with_tolerance(problem, fit, index, out[released], spread)
    if effects[index].name == "command_delay":
        out["delay"] = _whole_delay(problem, fit, out["delay"])
    return out


def at_known(matrix: Floats, known: Sequence[int]) -> Floats:
    """Return the covariance of coordinates if some of them were known, shape (p, p)."""
    told = matrix[:, known] @ np.linalg.pinv(matrix[np.ix_(known, known)]) @ matrix[known, :]
    return np.asarray(matrix - told)


def is_there(value: float, half: float, own: float) -> bool:
    """Return whether only the scale of all torques leaves open how large a number is.

    Args:
        value: The number.
        half: Half the width of its interval.
        own: The same if that scale were known.
    """
    return abs(value) > own and half > MOSTLY * own


def known_to_a_factor(value: float, half: float) -> list[float]:
    """Return the ends of an interval about a value, of that half width, as ratios.

    That of a guess is known to a factor of ten.
    """
    ratio = min(float(np.exp(half / abs(value))), TENFOLD)
    return sorted((value / ratio, value * ratio))


def along(unit: str) -> str:
    """Convert the unit of a rotary axis to that of a prismatic one: N m to N, rad to m."""
    return unit.replace("N m", "N").replace("rad", "m")


def _least(unknown: Number, value: float) -> float:
    """Return the smallest standard deviation of a coordinate."""
    relative = EXACT_SHAPE if unknown.shape and unknown.log else EXACT
    return relative / unknown.scale * (1.0 if unknown.log else abs(value))


def may_be_nothing(effect: Candidate, intervals: Mapping[str, Interval]) -> bool:
    """Return whether the intervals of an effect include its absence."""
    sizes = [unknown for unknown in effect.unknowns if not unknown.shape]
    pairs = [(unknown.start, intervals[unknown.symbol]) for unknown in sizes]
    return bool(pairs) and all(known.low <= none <= known.high for none, known in pairs)


def is_open(effect: Candidate, intervals: Mapping[str, Interval]) -> bool:
    """Return whether the one number of an effect is known to no better than a factor of ten."""
    if len(effect.unknowns) != 1 or not effect.unknowns[0].log:
        return False
    known = intervals[effect.unknowns[0].symbol]
    return known.high > TENFOLD * known.low


def at_an_end(effect: Candidate, intervals: Mapping[str, Interval]) -> bool:
    """Return whether a factor of a datasheet value or a sensor has reached its bound."""
    factors = [unknown for unknown in effect.unknowns if unknown.log and not unknown.shape]
    return any(
        known.low <= u.low or known.high >= u.high
        for u, known in ((u, intervals[u.symbol]) for u in factors)
    )


def _whole_delay(problem: Problem, fit: Fit, interval: Interval) -> Interval:
    """Return the dead time including the part below a sample that every fit leaves free.

    A current that follows its command at once reveals it in whole samples only.
    """
    setting = problem.stages.setting
    fields = problem.fields(fit.model, fit.z)
    total = fields["delay"] - setting.nominal["delay"]
    width = interval.high - interval.low if fields["lag"] > 0.0 else setting.series.dt
    half = 0.5 * min(width, setting.series.dt)
    return Interval(total, total - half, total + half, interval.unit)


def _with_tolerance(
    problem: Problem, fit: Fit, index: int, interval: Interval, spread: Covariance
) -> Interval:
    """Return the value that the model uses: of an effect and its nuisance together.

    What the one lacks the other makes up for, so that the record knows their product better.
    """
    field, (own,) = fit.model.effects[index].releases, fit.model.effects[index].unknowns
    assert field is not None
    total = problem.fields(fit.model, fit.z)[field]
    if interval.value == 0.0:
        return interval
    factor = total / interval.value
    if not 0.5 < factor < 2.0:
        return interval
    direction = np.zeros(len(fit.z))
    relative = own.scale if own.log else own.scale / total  # changes that the two have in common
    direction[problem.span(fit.model, index)] = relative
    for k, nuisance in enumerate(problem.shared):
        if nuisance.field == field:
            direction[k] = nuisance.unknown.scale
    half = NORMAL * max(spread.std_along(direction), EXACT)
    if not own.log and half >= 1.0:  # it may be none, or only its scale is open
        return interval
    ratio = float(np.exp(half))
    return Interval(total, total / ratio, total * ratio, interval.unit)
