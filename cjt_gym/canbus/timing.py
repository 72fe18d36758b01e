"""Timing of a control loop: lateness, and ages of what it saw."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.link import Arrival

PERCENTILES = (50.0, 90.0, 99.0, 99.9, 99.99, 100.0)


@dataclass
class Timing:
    """Times of all control steps of a run [s]."""

    lateness: array[float] = field(default_factory=lambda: array("d"))  # lateness of the command
    # age of the motor's angle when it is used
    ages: array[float] = field(default_factory=lambda: array("d"))
    # time from a command to the first report after it
    answers: array[float] = field(default_factory=lambda: array("d"))

    def answered(self, sent: float, arrivals: Sequence[Arrival]) -> float:
        """Note and return the time from a command to the next frame [s]; 0 without one."""
        for t, _ in arrivals:
            if t >= sent:
                self.answers.append(t - sent)
                return t - sent
        return 0.0

    def summary(self) -> dict[str, Any]:
        """Return percentiles of each in microseconds; empty without samples."""
        found: dict[str, Any] = {}
        for name, values in vars(self).items():
            if values:
                each = zip(PERCENTILES, np.percentile(values, PERCENTILES).tolist(), strict=True)
                found[name] = {f"p{p:g}": round(value * 1e6, 1) for p, value in each}
        return found

    def delay(self, dt: float) -> dict[str, float]:
        """Return the delays of the loop, as values of the simulator's delay effects [s].

        The command is delayed by its lateness and half of the round trip, the measurement by its
        age on arrival and the other half.

        Args:
            dt: Control step [s], which stands for the round trip if there was no answer.
        """
        return {name: round(float(np.median(v)), 6) for name, v in self._delays(dt).items()}

    def randomization(self, dt: float) -> dict[str, dict[str, Any]]:
        """Return the range of these delays, from 5 to 95 %, as a randomization for environments."""
        found = {}
        for name, values in self._delays(dt).items():
            low, high = (round(float(q), 6) for q in np.percentile(values, (5.0, 95.0)))
            found[name] = {"low": low, "high": high, "operation": "set"}
        return found

    def _delays(self, dt: float) -> dict[str, NDArray[np.float64]]:
        if not self.ages:
            return {}
        way = min(0.5 * float(np.median(self.answers)), dt) if self.answers else 0.0
        times = {"command_delay.delay": self.lateness, "measurement_delay.delay": self.ages}
        return {name: np.array(values) + way for name, values in times.items()}
