"""A stretch of a record in which something else acted, such as a hand, or the joint had changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import MOTION
from cjt_gym.gap.horizons.prediction.placement import stays
from cjt_gym.gap.horizons.prediction.windows import Windows
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

AHEAD = 0.1
"""Horizon over which a motion is looked at [s]: it shows a torque, not yet where it led."""
MOST = 0.9
"""Least share of what is left that lies in such a stretch."""
WITHIN = 0.4
"""Largest share of the windows of a record that are in it."""
FEWEST, ENOUGH = 3, 30
"""Fewest windows in it, and in a record that is looked at."""
MOVING = 0.003
"""Least square of what a joint or its model does in a window, relative to the usual one."""
FAR = 25.0
"""Least ratio of the median squares of the relative errors in it and outside."""
LARGE = 0.05
"""Least relative error in it."""


class Stretch(NamedTuple):
    """A stretch of a record.

    Attributes:
        log: Index of the record's log.
        start: Time at which it begins [s].
        stop: Time at which it ends [s].
        share: Share of the squared relative errors that lies in it.
    """

    log: int
    start: float
    stop: float
    share: float


def disturbed(windows: Windows, joint: Joint) -> Stretch | None:
    """Return the stretch in which nearly all lies that a joint does not do; None if it is spread.

    Errors are relative to the motion of their own window, so that larger motion is no such stretch.
    """
    key = (MOTION, AHEAD)
    if key not in windows.keys:
        return None
    at, first, found = windows.keys.index(key), 0, []
    errors = windows.errors(joint)[at][:, -1] * np.sqrt(windows.scales[at]) / windows.roots(key)
    for group in windows.groups_of(key):
        log, count = windows.logs[group.log], len(group.starts)
        points = group.points(AHEAD, log.dt)
        moved = log.measured[MOTION][group.starts + points[-1]]
        moved = moved - stays(log, *key, group.starts, points)[:, -1]
        error = errors[first : first + count]
        first += count
        most = np.maximum(moved**2, (moved + error) ** 2)
        good = np.isfinite(error) & (most > MOVING * np.mean(moved**2))
        if good.sum() < ENOUGH:
            continue
        square = error[good] ** 2 / (moved[good] ** 2 + np.median(moved[good] ** 2))
        span = _shortest(square)
        if span is not None:
            start, stop = log.t[group.starts[good]][[span[0], span[1] - 1]]
            share = float(square[slice(*span)].sum() / square.sum())
            found.append(Stretch(group.log, float(start), float(stop) + AHEAD, share))
    return max(found, key=lambda one: one.share, default=None)


def _shortest(square: Floats) -> tuple[int, int] | None:
    """Return first window and window after the last of the shortest stretch with most of it."""
    total = np.concatenate([[0.0], np.cumsum(square)])
    stops = np.searchsorted(total, total[:-1] + MOST * total[-1])
    counts = np.where(stops < len(total), stops - np.arange(len(square)), len(square))
    start = int(np.argmin(counts))
    stop = start + int(counts[start])
    inside, outside = square[start:stop], np.delete(square, slice(start, stop))
    if not FEWEST <= len(inside) <= WITHIN * len(square) or np.mean(inside) < LARGE**2:
        return None
    return (start, stop) if np.median(inside) > FAR * np.median(outside) else None
