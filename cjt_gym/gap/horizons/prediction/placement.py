"""Where the windows of a record start, and how many evenly spread ones each stands for.

A log that rests most of the time has its motion in few of the windows that are spread evenly. There
half of them are placed by how much moves: proportional to its rms, which is between a spread over
time, where a few windows decide, and one over the energy, where the largest motion has them all.
Each window then has a weight, so that means over the windows remain means over the record.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.pieces import SHORTEST, Piece
from cjt_gym.joint.kernel.arrays import Floats

Integers = NDArray[np.int64]
POINTS = 8
"""Number of evenly spaced samples of a window that are evaluated."""
WHOLE = 0.0
"""Horizon key of a piece that is predicted from its first sample to its last."""
LONG = 400
"""Number of samples of such a piece that are evaluated."""
EVEN = 0.5
"""Share of evenly spread windows that tell of the motion, above which all are spread evenly. It is
0.02 to 0.46 in 35 real cases, most of motors that rest between moves, and 0.5 to 0.93 in 80 others;
0.6 or more in 50 simulated ones."""
SPREAD, LIVELY = 0.5, 0.5
"""Share that is spread evenly otherwise, and the share that is placed by the motion."""
LOOKS = 20_000
"""Number of possible starts at which it is seen how much moves."""
OF_ONE = 0.125
"""Largest share of all motion that one piece counts for, so that one event does not get all."""
NOTHING = 1e-300


class Places(NamedTuple):
    """Where windows start.

    Attributes:
        starts: First sample of each, ascending, shape (W,).
        before: Samples of its piece before each, shape (W,).
        weights: Number of evenly spread windows that each stands for, on average 1, shape (W,).
    """

    starts: Integers
    before: Integers
    weights: Floats


def samples(horizon: float, dt: float) -> int:
    """Return the number of samples of a window for a horizon [s]."""
    return max(SHORTEST, round(horizon / dt))


@lru_cache(maxsize=256)  # every evaluation of a model asks for the same few
def points(horizon: float, length: int, dt: float) -> Integers:
    """Return the samples of a window of some length that are evaluated at a horizon."""
    if horizon == WHOLE:
        found = np.unique(np.linspace(1, length - 1, min(length, LONG)).astype(int))
    else:
        last = min(samples(horizon, dt), length) - 1
        found = np.unique(np.linspace(0, last, POINTS + 1).astype(int)[1:])
    found.flags.writeable = False
    return found


def stays(log: Log, channel: str, horizon: float, starts: Integers, at: Integers) -> Floats:
    """Return a channel extrapolated from each start at constant speed, shape (W, points)."""
    if channel == "tau" or horizon == WHOLE:
        return np.full((len(starts), 1), float(np.mean(log.measured[channel])))
    column = 0 if channel == "q_m" else 2
    states = log.first if log.from_slope else log.states
    q, v = states[starts, column], states[starts, column + 3]
    return np.asarray(q[:, None] + v[:, None] * at * log.dt, dtype=np.float64)


def placed(
    log: Log,
    own: Sequence[Piece],
    length: int,
    share: float,
    horizons: Sequence[float],
    kept: float = SPREAD,
) -> Places:
    """Return about `share` windows of some length in pieces that are longer than that.

    Of a log that mostly rests a share of `kept` of them is spread evenly.
    """
    even = _spread(own, length, share)
    places = [np.arange(p.start, p.stop - length, _stride(own, length)) for p in own]
    if len(even.starts) < 2 or not sum(map(len, places)):
        return even
    at = np.concatenate(places)
    piece = np.repeat(np.arange(len(own)), [len(x) for x in places])
    motion = _motion(log, at, length, horizons)
    if np.mean(motion) ** 2 >= EVEN * np.mean(motion**2):  # also where nothing moves
        return even
    each = np.bincount(piece, motion)
    motion *= np.minimum(1.0, OF_ONE * each.sum() / np.maximum(each, NOTHING))[piece]
    density = motion / motion.sum()
    count = round(LIVELY * len(even.starts))
    quantiles = (np.arange(count) + 0.5) / count
    lively = at[np.minimum(np.searchsorted(np.cumsum(density), quantiles), len(at) - 1)]
    starts, times = np.unique(
        np.concatenate([_spread(own, length, kept * share).starts, lively]), return_counts=True
    )
    index = np.searchsorted(at, starts, side="right") - 1
    before = starts - np.array([p.start for p in own])[piece[index]]
    weights = times / (kept + LIVELY * density[index] * len(at))
    return Places(starts, before, weights / weights.mean())


def _stride(own: Sequence[Piece], length: int) -> int:
    return max(sum(p.stop - p.start - length for p in own) // LOOKS, 1)


def _motion(log: Log, starts: Integers, length: int, horizons: Sequence[float]) -> Floats:
    """Return the rms of what moves beyond constant speed in the window from each start, relative.

    All channels and horizons count alike.
    """
    square = np.zeros(len(starts))
    for horizon in horizons:
        at = points(horizon, length, log.dt)
        for channel, values in log.measured.items():
            did = values[starts[:, None] + at] - stays(log, channel, horizon, starts, at)
            each = np.nan_to_num(np.mean(did**2, axis=1))
            square += each / max(float(np.mean(each)), NOTHING)
    return np.sqrt(square)


def _spread(own: Sequence[Piece], length: int, share: float) -> Places:
    """Return windows spread evenly over pieces.

    Where a piece has several, the last ends where the piece does: a quick stop there shows an
    inertia that slow motion does not.
    """
    total = sum(p.stop - p.start for p in own)
    starts: list[int] = []
    before: list[int] = []
    due = 0.0
    for p in own:
        due += share * (p.stop - p.start) / total
        count = int(due)
        due -= count
        room = p.stop - p.start - length
        places = np.unique(np.linspace(0.0 if count > 1 else room / 2, room, count).astype(int))
        starts += (p.start + places).tolist()
        before += places.tolist()
    ones = np.ones(len(starts))
    return Places(np.array(starts, dtype=np.int64), np.array(before, dtype=np.int64), ones)
