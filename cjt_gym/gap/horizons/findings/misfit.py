"""Intervals of the stages as wide as the motion that their joint leaves unpredicted calls for."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.diagnosis import Diagnosis, Interval
from cjt_gym.gap.digits import short
from cjt_gym.gap.recorded.tolerances import is_torque
from cjt_gym.gap.stages.intervals import NORMAL
from cjt_gym.joint import EFFECTS, JointFile
from cjt_gym.joint.files.diagnosed import covariance_of
from cjt_gym.joint.files.quantity import Quantity, freeze
from cjt_gym.joint.files.quantity import Setting as Entry

LEAST = 1e-12
"""Least value of a number that must not be zero."""


@dataclass(frozen=True)
class Wider:
    """How much wider intervals become.

    Attributes:
        by: Factor.
        common: Relative deviation of the scale of all torques, which stays as it is.
    """

    by: float
    common: float = 0.0

    def of(self, effect: str, symbol: str, one: Interval) -> Interval:
        """Return a wider interval of a number of an effect, within what it may be.

        One with ends at the same ratio from the value, not at the same distance, stays so.
        """
        value, parameter = one.value, EFFECTS[effect].parameter(symbol)
        fixed = NORMAL * self.common * value if is_torque(one.unit) else 0.0
        below, above = (self._half(abs(end - value), fixed) for end in (one.low, one.high))
        ends = [value - below, value + above]
        if one.low > 0.0 and fixed == 0.0:
            down, up = math.log(value / one.low), math.log(one.high / value)
            if abs(up - down) < abs(one.high + one.low - 2.0 * value) / value:
                ends = [value * math.exp(-self.by * down), value * math.exp(self.by * up)]
        if parameter is not None:
            least, strict, most = EFFECTS[effect].domain(parameter)
            least += LEAST if strict else 0.0
            ends = [max(ends[0], min(least, one.low)), min(ends[1], max(most, one.high))]
        return replace(one, low=short(ends[0]), high=short(ends[1]))

    def _half(self, half: float, fixed: float) -> float:
        own = math.sqrt(max(half**2 - fixed**2, 0.0))
        return math.hypot(self.by * own, min(abs(fixed), half))

    def joint(self, joint: JointFile, names: Collection[str]) -> JointFile:
        """Return a joint file with wider intervals of the named effects, and its covariance."""
        table: dict[str, Mapping[str, Entry]] = {**joint.effects}
        for name in table.keys() & set(names):
            table[name] = {s: self._entry(name, s, entry) for s, entry in table[name].items()}
        known = covariance_of(joint)
        if known is None:
            return replace(joint, effects=table)
        units = [_unit(joint, name) for name in known.names]
        scaled = known.values * np.array([float(is_torque(unit)) for unit in units])
        fixed = self.common**2 * np.outer(scaled, scaled)
        matrix = self.by**2 * (known.matrix - fixed) + fixed
        rows = tuple(tuple(map(short, row)) for row in matrix.tolist())
        covariance = {**joint.found["covariance"], "matrix": rows}  # type: ignore[dict-item]
        return replace(
            joint, effects=table, found=freeze({**joint.found, "covariance": covariance})
        )

    def _entry(self, effect: str, symbol: str, entry: Entry) -> Entry:
        if not isinstance(entry, Quantity) or not isinstance(entry.low, float):
            return entry
        assert isinstance(entry.high, float)
        known = Interval(entry.number, entry.low, entry.high, entry.unit)
        one = self.of(effect, symbol, known)
        return replace(entry, low=one.low, high=one.high)


def widened(told: Diagnosis, wider: Wider, spared: Collection[str]) -> Diagnosis:
    """Return a diagnosis with wider intervals, as those of its joint are.

    Args:
        told: The diagnosis.
        wider: How much wider.
        spared: Effects that no motion shows, such as those of sensors.
    """
    names = {e.name for e in told.effects} - set(spared)
    effects = tuple(
        replace(e, parameters={s: wider.of(e.name, s, x) for s, x in e.parameters.items()})
        if e.name in names
        else e
        for e in told.effects
    )
    return replace(told, effects=effects, joint=wider.joint(told.joint, names))


def _unit(joint: JointFile, name: str) -> str:
    """Return the unit of a number of a joint file, such as damping.d_m."""
    effect, _, symbol = name.rpartition(".")
    entry = joint.effects[effect][symbol] if effect else joint.parameters.quantities[symbol]
    return entry.unit if isinstance(entry, Quantity) else ""
