"""Averages of torque and motion over the same samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import convolve1d

from cjt_gym.joint.kernel.arrays import Floats


def averaged(channels: Sequence[Floats], count: int) -> list[Floats]:
    """Return channels averaged over so many samples, with the weights (1 - x^2)^2.

    All are averaged alike, so that fast motion is damped alike in torque and acceleration: a
    parabola fitted to the angle damps its second derivative more than a torque, and an inertia of
    fast motion came out a quarter too large.
    """
    weights = (1.0 - np.linspace(-1.0, 1.0, count + 2)[1:-1] ** 2) ** 2
    return [convolve1d(x, weights / weights.sum(), axis=0, mode="nearest") for x in channels]
