"""How sure the numbers of the stages' joint are, and how they vary together."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.diagnosis import Interval, NamedEffect, told_symbols
from cjt_gym.gap.identified import rounded
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.tolerances import common_deviation, is_torque
from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.gap.stages.intervals import NORMAL, Covariance
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.quantity import FrozenMapping, Plain, Quantity, freeze
from cjt_gym.joint.kernel.arrays import Floats

STEP = 0.01
"""Step of a coordinate for finite differences."""


def with_scale_of_torques(effect: NamedEffect, common: float) -> NamedEffect:
    """Return an effect whose intervals hold what the torque sensor's scale leaves open.

    Args:
        effect: The effect. What a sensor itself does is not in proportion to the true torque.
        common: Relative deviation of that scale.
    """
    if effect.stage == "sensing" or common == 0.0:
        return effect
    wide = {s: _with_scale(x, common) for s, x in effect.parameters.items()}
    return replace(effect, parameters=wide)


def _with_scale(one: Interval, common: float) -> Interval:
    if not is_torque(one.unit):
        return one
    more = NORMAL * common * one.value
    low = one.value - math.hypot(one.value - one.low, more)
    return replace(one, low=low, high=one.value + math.hypot(one.high - one.value, more))


def together(
    problem: Problem,
    fit: Fit,
    spread: Covariance,
    joint: JointFile,
    named: Sequence[NamedEffect],
    refined: Collection[str],
) -> FrozenMapping[Plain]:
    """Return the covariance of what was found, as a joint file states it.

    Args:
        problem: The record.
        fit: The explanation.
        spread: Covariance of its coordinates.
        joint: The joint that was found.
        named: The effects in it.
        refined: Symbols of its datasheet values that the record told.
    """
    setting = problem.stages.setting
    units = _units(joint, {e.name for e in named if e.stage != "sensing"}, refined)

    def numbers(z: Floats) -> Floats:
        known = _numbers(written(problem, fit.model, z).file)
        return np.array([known.get(name, math.nan) for name in units])

    slopes = np.zeros((len(units), len(fit.z)))
    for k, ahead in enumerate(STEP * np.eye(len(fit.z))):
        slopes[:, k] = (numbers(fit.z + ahead) - numbers(fit.z - ahead)) / (2.0 * STEP)
    values = np.array([_numbers(joint)[name] for name in units])
    scaled = values * np.array([float(is_torque(unit)) for unit in units.values()])
    common = common_deviation(
        setting.joint, cut=setting.cut is Cut.BY_TORQUE, but=told_symbols(named)
    )
    matrix = slopes @ spread.matrix @ slopes.T + common**2 * np.outer(scaled, scaled)
    kept = np.flatnonzero(np.isfinite(slopes).all(axis=1) & (np.diag(matrix) > 0.0))
    table = {
        "names": tuple(list(units)[k] for k in kept),
        "values": tuple(values[kept].tolist()),
        "matrix": tuple(tuple(map(rounded, row)) for row in matrix[np.ix_(kept, kept)].tolist()),
    }
    return freeze({"covariance": table} if len(kept) else {})


def _units(joint: JointFile, effects: Collection[str], refined: Collection[str]) -> dict[str, str]:
    """Return the units of the refined values and of the numbers of effects, by their names."""
    quantities = joint.parameters.quantities
    found = {s: q.unit for s, q in quantities.items() if s in refined}
    for name, entries in joint.effects.items():
        for symbol, entry in entries.items() if name in effects else ():
            if isinstance(entry, Quantity) and isinstance(entry.low, float):
                found[f"{name}.{symbol}"] = entry.unit
    return found


def _numbers(joint: JointFile) -> dict[str, float]:
    """Return all single numbers of a joint file by their names."""
    found = {s: q.number for s, q in joint.parameters.quantities.items()}
    for name, row in joint.effects.items():
        for symbol, entry in row.items():
            if isinstance(entry, Quantity) and not isinstance(entry.value, tuple):
                found[f"{name}.{symbol}"] = entry.number
    return found
