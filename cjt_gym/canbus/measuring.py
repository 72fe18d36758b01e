"""From the nodes' reports to the measurement of a plant."""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import itemgetter
from typing import final

import numpy as np

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import CHANNELS
from cjt_gym.plant import Measurement

CHANNEL_VALUES = itemgetter(*CHANNELS)


@final
class Sense:
    """Completes the reported channels from the structure of the joint.

    A rigid gearbox has the motor's angle, and a fixed output does not move. Without a torque sensor
    the joint torque is k_b times the spring's deflection since the start of the run. Unknown
    channels are NaN.

    Attributes:
        measured: Channels that a sensor reports.
        torque: Source of the joint torque: "sensor" or "spring".
    """

    def __init__(self, config: HardwareConfig, reported: frozenset[str]) -> None:
        """Determine which channels can be known from those that the nodes report."""
        p, row = config.joint.parameters, config.joint.structure_row
        has = {**dict.fromkeys(reported, True), "i": bool({"i", "tau_m"} & reported)}
        self.measured = tuple(name for name in CHANNELS if has.get(name))
        self._merged = not row.has_gear
        self._is_rigid = self._merged and not row.has_spring
        self._is_fixed = row.output_fixed
        self._k_b = p.get("k_b", math.nan)
        self._per_ampere = p.k_t * p.n
        if "q_m" not in reported:
            raise ConfigurationError(
                f"Some node of {config.origin} must report the motor's angle q_m, got "
                f"{', '.join(sorted(reported)) or 'no channel'}."
            )
        twist = ("q_g" in reported or self._merged) and ("q_l" in reported or self._is_fixed)
        wanted = config.torque
        if wanted == "auto":
            wanted = "sensor" if "tau" in reported else "spring"
        missing = wanted == "sensor" and "tau" not in reported
        if missing or (wanted == "spring" and (not twist or self._is_rigid)):
            lacks = f"no node reports {'tau' if missing else 'both ends of the spring'}"
            if self._is_rigid and not missing:
                lacks = f"the structure {row.name} has no spring, and no node reports tau"
            raise ConfigurationError(
                f"The joint torque of {config.origin} cannot be known: {lacks}. Add a sensor: a "
                "table [sensors.NAME] with its protocol."
            )
        self.torque = wanted
        self._relaxed = 0.0
        self._before: dict[str, tuple[float, float]] = {}

    def zero(self, values: Mapping[str, float]) -> None:
        """Take the present deflection as zero torque, and forget velocities."""
        q_g = values.get("q_g", values["q_m"] if self._merged else math.nan)
        self._relaxed = q_g - values.get("q_l", 0.0)
        self._before.clear()

    def complete(self, full: dict[str, float], t: float) -> dict[str, float]:
        """Complete and return the channels of a measurement."""
        q_m = full["q_m"]
        if "dq_m" not in full:
            full["dq_m"] = self._rate("q_m", q_m, t)
        if "i" not in full:
            full["i"] = full.get("tau_m", math.nan) / self._per_ampere
        if "tau_m" not in full:
            full["tau_m"] = full["i"] * self._per_ampere
        full.setdefault("q_g", q_m if self._merged else math.nan)
        full.setdefault("dq_g", full["dq_m"] if self._merged else math.nan)
        if self._is_rigid:
            full.setdefault("q_l", q_m)
            full.setdefault("dq_l", full["dq_m"])
        if "q_l" not in full:
            full["q_l"] = full["dq_l"] = 0.0 if self._is_fixed else math.nan
        elif "dq_l" not in full:
            full["dq_l"] = self._rate("q_l", full["q_l"], t)
        if self.torque == "spring":
            full["tau"] = self._k_b * (full["q_g"] - full["q_l"] - self._relaxed)
        full["deflection"] = full["tau"] / self._k_b
        return full

    def _rate(self, name: str, value: float, t: float) -> float:
        """Return the velocity from the difference to the previous value."""
        before, then = self._before.get(name, (value, t))
        self._before[name] = (value, t)
        return (value - before) / (t - then) if t > then else 0.0

    def measurement(self, full: Mapping[str, float], t: float) -> Measurement:
        """Return completed channels as a plant's measurement, each of shape (1,)."""
        return Measurement(*np.array((t, *CHANNEL_VALUES(full)))[:, None])
