"""Intervals of the stages as wide as the motion that their joint leaves unpredicted calls for."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from cjt_gym.gap.diagnosis import Diagnosis, Interval
from cjt_gym.joint import EFFECTS, JointFile
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.files.quantity import Setting as Entry

LEAST = 1e-12
"""Least value of a number that must not be zero."""


def widened(told: Diagnosis, by: float, spared: Collection[str]) -> Diagnosis:
    """Return a diagnosis whose intervals are wider by a factor, as is its joint.

    Args:
        told: The diagnosis.
        by: The factor.
        spared: Effects that no motion shows, such as those of sensors.
    """
    names = {e.name for e in told.effects} - set(spared)
    effects = tuple(
        replace(e, parameters={s: _wider(e.name, s, x, by) for s, x in e.parameters.items()})
        if e.name in names
        else e
        for e in told.effects
    )
    return replace(told, effects=effects, joint=_joint(told.joint, names, by))


def _joint(joint: JointFile, names: Collection[str], by: float) -> JointFile:
    table: dict[str, Mapping[str, Entry]] = {**joint.effects}
    for name in table.keys() & set(names):
        table[name] = {s: _entry(name, s, entry, by) for s, entry in table[name].items()}
    return replace(joint, effects=table)


def _entry(effect: str, symbol: str, entry: Entry, by: float) -> Entry:
    if not isinstance(entry, Quantity) or not isinstance(entry.low, float):
        return entry
    assert isinstance(entry.high, float)
    one = _wider(effect, symbol, Interval(entry.number, entry.low, entry.high, entry.unit), by)
    return replace(entry, low=one.low, high=one.high)


def _wider(effect: str, symbol: str, one: Interval, by: float) -> Interval:
    """Return an interval wider by a factor, within what the number may be.

    One with ends at the same ratio from the value, not at the same distance, stays so.
    """
    parameter = EFFECTS[effect].parameter(symbol)
    ends = [one.value + by * (end - one.value) for end in (one.low, one.high)]
    if one.low > 0.0:
        down, up = math.log(one.value / one.low), math.log(one.high / one.value)
        if abs(up - down) < abs(one.high + one.low - 2.0 * one.value) / one.value:
            ends = [one.value * math.exp(-by * down), one.value * math.exp(by * up)]
    if parameter is not None:
        least, strict, most = EFFECTS[effect].domain(parameter)
        least += LEAST if strict else 0.0
        ends = [max(ends[0], min(least, one.low)), min(ends[1], max(most, one.high))]
    return replace(one, low=ends[0], high=ends[1])
