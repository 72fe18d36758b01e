"""How regular a control loop was, and how old what it saw."""

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
    """Times of every control step of a run, in seconds.

    Attributes:
        lateness: Of the command behind its deadline.
        ages: Of the motor's angle at the instant of control.
        answers: From a command to the first report after it.
    """

    lateness: array[float] = field(default_factory=lambda: array("d"))
    ages: array[float] = field(default_factory=lambda: array("d"))
    answers: array[float] = field(default_factory=lambda: array("d"))

    def answered(self, sent: float, arrivals: Sequence[Arrival]) -> float:
        """Note and return how long the first frame after a command took [s], 0 where none came.

        Args:
            sent: When the command was sent [s].
            arrivals: What was heard at the end of its control step.
        """
        took = next((t - sent for t, _ in arrivals if t >= sent), None)
        if took is not None:
            self.answers.append(took)
        return took or 0.0

    def summary(self) -> dict[str, Any]:
        """Return percentiles of each in microseconds, as plain data; empty without samples."""
        return {
            name: {f"p{p:g}": round(float(value) * 1e6, 1) for p, value in _percentiles(values)}
            for name, values in vars(self).items()
            if len(values)
        }

    def delay(self, dt: float) -> dict[str, float]:
        """Return what the loop adds to a joint, as values of the simulator's delays [s].

        The command acts as late as it is sent, and half of what it takes until the answer; what is
        measured is as old as it was on arrival and the other half.

        Args:
            dt: Control step [s], the answer's time where none was seen.
        """
        return {name: round(float(np.median(v)), 6) for name, v in self._delays(dt).items()}

    def randomization(self, dt: float) -> dict[str, dict[str, Any]]:
        """Return how these delays vary, as environments draw parameters: from 5 to 95 % of them.

        Args:
            dt: Control step [s].
        """
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


def _percentiles(values: array[float]) -> list[tuple[float, float]]:
    found = np.percentile(np.frombuffer(values), PERCENTILES)
    return list(zip(PERCENTILES, found.tolist(), strict=True))
