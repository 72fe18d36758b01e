"""Noise of a measured angle, and of the speed that is its slope."""

from __future__ import annotations

import numpy as np
from scipy.special import binom

from cjt_gym.gap.horizons.prediction.log import Log, usual_count
from cjt_gym.joint.kernel.arrays import Floats

DIFFERENCES = 3
"""Order of the differences of an angle that show its noise."""


def angle_noise(x: Floats) -> float:
    """Return the standard deviation of an angle's noise, or of its rounding."""
    weights = binom(DIFFERENCES, np.arange(DIFFERENCES + 1))
    spread = float(np.std(np.diff(x, DIFFERENCES))) / float(np.sqrt(np.sum(weights**2)))
    return max(spread, 1e-6 * float(np.ptp(x)), 1e-12)


def speed_noise(log: Log) -> float:
    """Return the standard deviation that noise of the motor's angle makes in its slope."""
    count = usual_count(log.dt)
    slope = float(np.sqrt(12.0 / (count * (count**2 - 1)))) / log.dt
    return angle_noise(log.angles[:, 0]) * slope
