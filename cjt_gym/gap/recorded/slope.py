"""Whether a measured velocity is the slope of its angle, and how late it is."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records.doubts import ALIKE, LATE, lag_of

AHEAD = 0.5
"""Time over which a velocity is integrated [s], or half the record's if that is shorter."""
FEWEST = 5
"""Fewest samples over which it is."""
ASTRAY = 0.15
"""Largest deviation of that integral from the change of the angle, relative to the change."""
SCALED, SURE = 0.03, 3.0
"""Least relative difference of a scale from 1, and its least ratio to the deviation that remains
without it. Two motors whose clock was wrong, each at three rates, differed by 0.075 to 0.245 with
ratios of 9 to 50; velocities of six other machines by up to 0.08, with ratios below 1."""

FURTHER, NOISIER = 0.1, 0.65
"""Time over which motion at a constant speed is extrapolated [s], and the ratio of its errors with
the slope of an angle and with a measured velocity below which that is noise. On six logs of two
joints of one arm it was 0.19 to 0.48, on six of three joints of another 0.83 to 1.55."""


def integrated(speed: Floats, angle: Floats, dt: float) -> tuple[float, float, float]:
    """Return how the integral of a velocity over `AHEAD` goes with the change of its angle.

    Args:
        speed: The velocity, shape (N,).
        angle: The angle, shape (N,).
        dt: Distance of the samples [s].

    Returns:
        The factor from the change to the integral, and the relative deviations of the integral
        from the change and from the change times the factor.
    """
    rows = min(max(round(AHEAD / dt), FEWEST), max(len(angle) // 2, 1))
    way = angle[rows:] - angle[:-rows]
    total = cumulative_trapezoid(speed, dx=dt, initial=0.0)
    turned = total[rows:] - total[:-rows]
    power = float(way @ way)
    if power <= 0.0:
        return 1.0, np.inf, np.inf
    factor = float(way @ turned) / power
    off, rest = (float(np.sum((turned - k * way) ** 2) / power) ** 0.5 for k in (1.0, factor))
    return factor, off, rest


def is_scaled(factor: float, rest: float) -> bool:
    """Return whether a factor between a velocity and the slope of its angle is not 1."""
    return abs(factor - 1.0) > max(SCALED, SURE * rest)


def is_slope(speed: Floats, angle: Floats, dt: float) -> bool:
    """Return whether a measured velocity integrates to the change of its angle."""
    factor, off, rest = integrated(speed, angle, dt)
    return off < ASTRAY and not is_scaled(factor, rest)


def is_noise(speed: Floats, slope: Floats, angle: Floats, dt: float) -> bool:
    """Return whether a measured velocity tells much less of the motion ahead than a slope.

    Args:
        speed: The measured velocity, shape (N,).
        slope: The slope of the angle, smoothed, shape (N,).
        angle: The angle, shape (N,).
        dt: Distance of the samples [s].
    """
    rows = max(round(FURTHER / dt), FEWEST)
    way = angle[rows:] - angle[:-rows]
    measured, smooth = (float(np.sum((way - v[:-rows] * rows * dt) ** 2)) for v in (speed, slope))
    return smooth < NOISIER**2 * measured


def in_time(speed: Floats, angle: Floats) -> Floats:
    """Return a velocity, shape (N,), without the time by which a filter makes it late."""
    late, alike = lag_of(np.gradient(angle), speed)
    if alike < ALIKE or abs(late) <= LATE:
        return speed
    rows = np.arange(len(speed), dtype=float)
    return np.interp(rows + late, rows, speed)
