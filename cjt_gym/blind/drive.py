"""The drive: from the command to the motor current."""

from __future__ import annotations

import math

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.plant import Drive, Floats
from cjt_gym.blind.state import CURRENT, SLEWED


@jit
def reference_current(d: Drive, command: float) -> float:
    """Return the reference of the current loop: rounded, after dead zone and limit [A]."""
    value = command
    if d.resolution > 0.0:
        value = d.resolution * math.floor(value / d.resolution + 0.5)
    if d.dead > 0.0:
        value = math.copysign(max(abs(value) - d.dead, 0.0), value)
    return min(max(value, -d.i_max), d.i_max)


@jit
def advance_current(d: Drive, x: Floats, command: float, h: float) -> None:
    """Advance the current by h in place: slew limit, then a first-order lag, exact for a step."""
    target = reference_current(d, command)
    change = min(max(target - x[SLEWED], -d.slew * h), d.slew * h)
    x[SLEWED] += change
    decay = math.exp(-2.0 * math.pi * d.bandwidth * h)
    x[CURRENT] = x[SLEWED] + (x[CURRENT] - x[SLEWED]) * decay
