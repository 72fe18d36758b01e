"""Evenly sampled stretches of a log between its gaps, and smoothing of their angles."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from cjt_gym.gap.check.clock import gap_length
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

Columns = dict[str, Floats]
ORDER = 3
"""Order of the smoothing polynomials."""
MANY = 20
"""Number of windows above which a stretch is long; a broken log has hundreds of short ones."""
USED = ("i", "i_cmd", "tau_m", "tau_cmd", "tau", "q_m", "q_g", "q_l", "dq_m", "dq_l")
"""Channels that must be present for a sample to be valid."""


def stretches(record: Record, channels: Collection[str]) -> list[Columns]:
    """Return the channels of a record on even time grids, split at its gaps."""
    t, dt = record.t, record.dt
    gap = gap_length(np.diff(t))
    ends = np.flatnonzero(np.diff(t) > gap) + 1
    found = []
    for rows in np.split(np.arange(len(t)), ends):
        if len(rows) < 4:
            continue
        grid = t[rows[0]] + dt * np.arange(int((t[rows[-1]] - t[rows[0]]) / dt + 1.5))
        piece: Columns = {"t": grid}
        valid = np.ones(len(grid), dtype=bool)
        for name in channels:
            known = rows[np.isfinite(record[name][rows])] if name in record else rows[:0]
            if len(known) < 2:
                piece[name] = np.zeros(len(grid))
                valid[:] = False
                continue
            piece[name] = np.interp(grid, t[known], record[name][known])
            near = np.searchsorted(t[known], grid).clip(1, len(known) - 1)
            apart = t[known][near] - t[known][near - 1]
            valid &= (apart < gap) | (name not in USED)
        piece["valid"] = valid.astype(np.float64)
        found.append(piece)
    return found


def motion(piece: Columns, angle: str, stiffness: float, width: int) -> Columns:
    """Return the smoothed angle, speed and acceleration of a body.

    Args:
        piece: The channels of a stretch.
        angle: The channel of the body's motion: an angle, a velocity, or the torque of a spring to
            a held output.
        stiffness: Stiffness of that spring [N m/rad].
        width: Number of samples of the smoothing window.
    """
    x, dt = piece[angle], float(piece["t"][1] - piece["t"][0])
    if angle == "tau":
        x = x / stiffness
    if angle.startswith("dq_"):
        v, a = smooth(x, width), smooth(x, width, 1, dt)
        return {"q": np.cumsum(x) * dt, "v": v, "a": a}
    speed, acceleration = smooth(x, width, 1, dt), smooth(x, width, 2, dt)
    return {"q": smooth(x, width), "v": speed, "a": acceleration}


def smooth(x: Floats, width: int, order: int = 0, dt: float = 1.0) -> Floats:
    """Return a channel or its derivative, smoothed by polynomials, shape (N,)."""
    if len(x) > MANY * width:
        return np.asarray(savgol_filter(x, width, ORDER, deriv=order, delta=dt), dtype=np.float64)
    weights, half = _weights(width, order), width // 2
    inner = np.correlate(x, weights[half], "valid")
    ends = weights[:half] @ x[:width], weights[half + 1 :] @ x[-width:]
    return np.concatenate([ends[0], inner, ends[1]]) / dt**order


@cache
def _weights(width: int, order: int) -> Floats:
    """Return the matrix that smooths `width` samples; SciPy fits its ends anew for every call."""
    return np.asarray(savgol_filter(np.eye(width), width, ORDER, deriv=order, axis=0))


def gain(width: int, order: int, dt: float, angle: str) -> float:
    """Return the ratio of a smoothed derivative's deviation to that of a sample."""
    order -= angle.startswith("dq_")
    return float(np.linalg.norm(savgol_coeffs(width, ORDER, deriv=order, delta=dt)))


def changes(way: NDArray[np.float64], rest: int) -> int:
    """Return how often motion reverses, or starts after more than `rest` samples of rest."""
    at = np.flatnonzero(way)
    if len(at) < 2:
        return len(at)
    turned = way[at[1:]] != way[at[:-1]]
    return int(np.sum(turned | (np.diff(at) > rest))) + int(at[0] > rest)
