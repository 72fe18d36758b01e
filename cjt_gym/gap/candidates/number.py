"""Numbers that a fit may change: their names, starting values and bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Starts = tuple[tuple[float, ...], ...]
"""Starting points of a fit, each with one value per number."""
STEP = 0.02
"""Usual step of a finite difference, in units of a coordinate."""


@dataclass(frozen=True)
class Number:
    """One free number, represented by a coordinate z that is 0 at the start value."""

    symbol: str  # its name in reports
    unit: str
    start: float  # value at z = 0 [unit]
    scale: float  # change per unit of z: relative if `log`, else in the unit
    log: bool = False  # whether the value is start * exp(scale z) rather than start + scale z
    low: float = -np.inf  # smallest value [unit]
    high: float = np.inf  # largest value [unit]
    prior: bool = True  # whether z has a Gaussian prior of mean 0 and deviation 1
    # whether it only shapes an effect, whose size is given by other numbers; those are at their
    # start if the effect is absent
    shape: bool = False
    # step of a finite difference, in units of z. A delay acts in whole substeps.
    step: float = STEP

    def value(self, z: float) -> float:
        """Return the value [unit] at a coordinate."""
        if self.log:
            raw = self.start * float(np.exp(np.clip(self.scale * z, -20.0, 20.0)))
        else:
            raw = self.start + self.scale * z
        return min(max(raw, self.low), self.high)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value [unit], limited to its bounds."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return float(np.log(max(value / self.start, 1e-9)) / self.scale)
        return (value - self.start) / self.scale

    def at_bound(self, z: float) -> bool:
        """Return whether the value is stuck at one of its bounds, but for rounding."""
        value = self.value(z)
        near = 1e-9 * (abs(value) if self.log else self.scale)
        return value <= self.low + near or value >= self.high - near
