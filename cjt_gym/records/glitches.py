"""Samples of one channel that cannot be what they say: glitches, repeated ones, turns of a counter.

Commands are never touched: a command may do anything. A channel has the shape (n,), with NaN where
a sample is missing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.records.checks import FloatArray

LONGEST_GLITCH = 4
"""Samples that a glitch may last."""
WINDOW = 401
"""Samples around a glitch with which it is compared."""
OUTSTANDING = 8.0
"""Factor by which its edges exceed those around it."""
RETURN = 0.35
"""Share of the edge up to which a channel has to come back after it."""
COMMON = 0.02
"""Share of samples above which they are no glitches but how the channel is."""
FEWEST = 20
"""Samples without which nothing can be told."""
APART = 20.0
"""Distance from all others, in their range, over which an angle does not leap and come back."""
ALONE, BESIDE = 20.0, 10
"""Factor by which a first or last edge of an angle exceeds those beside it, and their number."""
STEEP = 3.0
"""Steps of a channel's lattice per sample over which one that stands still is stale."""
FINE = 30.0
"""Steps of the lattice beside which two equal samples are no chance."""
LONGEST_FREEZE, FREEZES = 100, 3
"""Samples for which a channel may stand still and be called frozen, and how often it has to."""
STEADY = 5
"""Samples before and after it from which the speed there is taken."""
ALIKE, SELDOM = 25, 0.05
"""Samples that are the same to the last digit from which a measured current is none, and share of
such samples beside them above which it is merely coarse."""
SLOWEST = 100
"""Samples of the log, for one of the sensor, up to which a sensor is called slow."""


def glitches(x: FloatArray, *, angle: bool = False) -> NDArray[np.bool_]:
    """Return which samples are glitches: off and back again within a few samples, and far.

    The edges of a glitch exceed nearly all changes of the channel in the samples around it, its
    steady slope taken off, and lead back to where the channel came from. A step stays where it is;
    so it is none. With `angle` the few samples before a first or after a last jump are glitches as
    well: what is outside the log does not tell, but a joint does not step. Nor does it leap far
    from where it is otherwise, however long that lasts.
    """
    out = np.zeros(len(x), dtype=bool)
    known = np.flatnonzero(np.isfinite(x))
    if len(known) < FEWEST:
        return out
    y = x[known]
    edges = np.diff(y)
    from scipy.ndimage import median_filter  # takes long to import

    edges = edges - median_filter(edges, 9, mode="nearest")
    high = np.flatnonzero(np.abs(edges) > _limit(edges, y))
    for begin, end in _runs(high, edges, y):
        out[known[begin:end]] = True
    if angle:
        out[known[_apart(y)]] = True
        begins, ends = _false_ends(y)
        out[known[:begins]] = out[known[ends:]] = True
    return out if out.sum() <= COMMON * len(known) else np.zeros(len(x), dtype=bool)


def _false_ends(y: FloatArray) -> tuple[int, int]:
    """Return where an angle begins after a jump from its first samples, and ends before one."""
    edges = np.diff(y)
    size, steps = np.abs(edges), np.abs(np.diff(np.unique(y)))
    least = ALONE * float(np.median(steps)) if len(steps) else 0.0
    out = size > _limit(edges, y)
    for k in range(LONGEST_GLITCH):  # all but at rest beside it
        out[k] |= size[k] > max(ALONE * size[k + 1 : k + 1 + BESIDE].max(), least)
        out[-1 - k] |= size[-1 - k] > max(ALONE * size[-1 - k - BESIDE : -1 - k].max(), least)
    high = np.flatnonzero(out)
    first, last = high[high < LONGEST_GLITCH], high[high >= len(edges) - LONGEST_GLITCH]
    return int(first[-1]) + 1 if len(first) else 0, int(last[0]) + 1 if len(last) else len(y)


def _apart(y: FloatArray) -> NDArray[np.bool_]:
    """Return which few samples of an angle lie together, far from all others, none between."""
    out = np.zeros(len(y), dtype=bool)
    few = int(COMMON * len(y))
    if few == 0:
        return out
    ordered = np.sort(y)
    gaps = np.diff(ordered)
    least = APART * float(ordered[-1 - few] - ordered[few])
    low, high = int(np.argmax(gaps[:few])), len(gaps) - few + int(np.argmax(gaps[-few:]))
    if gaps[low] > max(least, APART * gaps[:low].max(initial=0.0)) > 0.0:
        out |= y <= ordered[low]
    if gaps[high] > max(least, APART * gaps[high + 1 :].max(initial=0.0)) > 0.0:
        out |= y >= ordered[high + 1]
    return out


def _limit(edges: FloatArray, y: FloatArray) -> FloatArray:
    """Return the size from which an edge stands out, shape of `edges`."""
    size = np.abs(edges)
    count = max(len(size) // WINDOW, 1)
    blocks = np.array_split(size, count)
    usual = np.array([np.quantile(block, 0.95) for block in blocks])
    usual = np.maximum.reduce([usual, np.roll(usual, 1), np.roll(usual, -1)])
    steps = np.abs(np.diff(np.unique(y)))
    lattice = float(np.median(steps)) if len(steps) else 0.0
    everywhere = float(np.quantile(size, 0.5))
    limit = OUTSTANDING * np.maximum(usual, max(everywhere, lattice))
    return np.repeat(limit, [len(block) for block in blocks])


def _runs(high: NDArray[np.intp], edges: FloatArray, y: FloatArray) -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    k = 0
    while k < len(high):
        up = high[k]
        back = next(
            (
                down
                for down in high[k + 1 : k + 2 + LONGEST_GLITCH]
                if down - up <= LONGEST_GLITCH
                and edges[down] * edges[up] < 0.0
                and _returns(y, edges, int(up), int(down))
            ),
            None,
        )
        if back is None:
            k += 1
            continue
        found.append((int(up) + 1, int(back) + 1))
        k = int(np.searchsorted(high, back, side="right"))
    return found


def _returns(y: FloatArray, edges: FloatArray, up: int, down: int) -> bool:
    """Return whether the channel after the edge `down` goes on from before the edge `up`."""
    slope = float(np.median(np.diff(y[max(up - 4, 0) : up + 1]))) if up >= 2 else 0.0
    across = y[down + 1] - y[up] - slope * (down + 1 - up)
    return bool(abs(across) < RETURN * min(abs(edges[up]), abs(edges[down])))


def stale(x: FloatArray) -> NDArray[np.bool_]:
    """Return which samples repeat the one before although the channel has moved on.

    That is so for a few equal samples between two of a steady motion, where the change after them
    makes up for what was missed, and for any few equal samples of a channel so finely resolved
    that chance does not make them equal.
    """
    out = np.zeros(len(x), dtype=bool)
    known = np.flatnonzero(np.isfinite(x))
    if len(known) < FEWEST:
        return out
    y = x[known]
    d = np.diff(y)
    moves = np.flatnonzero(d != 0.0)
    if len(moves) < FEWEST or len(moves) == len(d):
        return out
    lattice, fine = _lattice(y)
    if not _more_than_chance(d, lattice):
        return out
    still = np.diff(moves) - 1  # samples that repeat, between one change and the next
    before, after = np.abs(d[moves[:-1]]), np.abs(d[moves[1:]])
    rate = after / (still + 1.0)
    onward = (d[moves[:-1]] * d[moves[1:]] > 0.0) & (rate > STEEP * lattice)
    onward &= (after > 1.5 * before) & (rate > 0.4 * before) & (rate < 2.5 * before)
    chance = np.maximum(before, after) < FINE * lattice
    repeats = (still > 0) & (still <= LONGEST_GLITCH) & (onward | (fine & ~chance))
    for k in np.flatnonzero(repeats):
        out[known[moves[k] + 2 : moves[k + 1] + 1]] = True
    return out


def frozen(x: FloatArray) -> NDArray[np.bool_]:
    """Return which samples repeat an old one for long while the channel moves on unseen.

    One jump after them makes up for all that was missed: it is as far as the speeds before and
    after it lead in that time. A joint that sticks moves off from where it stood instead.
    """
    out = np.zeros(len(x), dtype=bool)
    known = np.flatnonzero(np.isfinite(x))
    if len(known) < FEWEST:
        return out
    y = x[known]
    d = np.diff(y)
    moves = np.flatnonzero(d != 0.0)
    still = np.diff(moves) - 1
    lattice, _ = _lattice(y)
    long = still > LONGEST_GLITCH
    if long.sum() > COMMON * len(still):  # the sensor is coarse or slower than the log
        return out
    for k in np.flatnonzero(long & (still <= LONGEST_FREEZE)):
        begin, end = int(moves[k]), int(moves[k + 1])
        before, after = d[max(begin + 1 - STEADY, 0) : begin + 1], d[end + 1 : end + 1 + STEADY]
        if len(before) < STEADY or len(after) < STEADY:
            continue
        rate = d[end] / (end - begin)
        speeds = np.array([before.mean(), after.mean()]) / rate
        if abs(rate) > STEEP * lattice and speeds.min() > 0.4 and speeds.max() < 2.5:
            out[known[begin + 2 : end + 1]] = True
    runs = int(np.sum(np.diff(out.astype(int), prepend=0) > 0))
    return out if runs >= FREEZES else np.zeros(len(x), dtype=bool)


def stuck(x: FloatArray, moves: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which samples only repeat the last one measured, as of a drive that is switched off.

    A measured current is never the same for long while the joint moves, unless it is zero or at an
    end of its range.

    Args:
        x: The channel, shape (n,).
        moves: Where the joint has moved since the sample before, shape (n,).
    """
    same = np.diff(x, prepend=np.nan) == 0.0
    edges = np.diff(same.astype(int), prepend=0, append=0)
    runs = zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
    cut = 0.0, np.nanmin(x, initial=np.inf), np.nanmax(x, initial=-np.inf)  # off, or cut off there
    long = [(begin, end) for begin, end in runs if end - begin >= ALIKE and x[begin] not in cut]
    out = np.zeros(len(x), dtype=bool)
    for begin, end in long:
        out[begin:end] = True
    steps = np.abs(np.diff(x, prepend=np.nan))[moves & ~out]
    steps = steps[np.isfinite(steps)]
    seen = any(np.mean(moves[begin:end]) > 0.5 for begin, end in long)
    if not seen or len(steps) < FEWEST or np.mean(steps == 0.0) > SELDOM:
        return np.zeros(len(x), dtype=bool)
    lattice, _ = _lattice(x[np.isfinite(x)])
    fine = float(np.median(steps)) > STEEP * lattice
    return out if fine else np.zeros(len(x), dtype=bool)


def _more_than_chance(d: FloatArray, lattice: float) -> bool:
    """Return whether more samples of a moving channel are equal than a few steps apart."""
    size = np.abs(d)
    moving = np.minimum(size[:-2], size[2:]) > STEEP * lattice
    steps = np.round(size[1:-1][moving] / lattice) if lattice else size[1:-1][moving]
    equal = int(np.sum(steps == 0.0))
    beside = sum(int(np.sum(steps == k)) for k in (1, 2, 3)) / 6.0
    return bool(equal > 3.0 * beside + 5.0)


def held(x: FloatArray) -> tuple[NDArray[np.bool_], int]:
    """Return which samples only hold the last one of a sensor slower than the log, and its period.

    Returns:
        Whether a sample is held, shape (n,), and after how many samples a new one comes; 1 where
        the sensor keeps up.
    """
    out = np.zeros(len(x), dtype=bool)
    known = np.flatnonzero(np.isfinite(x))
    moves = np.flatnonzero(np.diff(x[known]) != 0.0) + 1
    if len(moves) < FEWEST:
        return out, 1
    y = x[known]
    lattice, _ = _lattice(y)
    apart = np.diff(moves)
    large = np.abs(y[moves[1:]] - y[moves[1:] - 1]) > STEEP * lattice
    if large.sum() < max(FEWEST, 0.2 * len(apart)):
        return out, 1
    period = int(np.median(apart[large]))
    regular = np.abs(apart[large] / period - np.round(apart[large] / period).clip(1)) < 0.01
    if not 2 <= period <= SLOWEST or regular.mean() < 0.9 or (apart[large] < period).mean() > 0.02:
        return out, 1
    out[known] = True
    out[known[moves]] = False
    return out, period


def _lattice(y: FloatArray) -> tuple[float, bool]:
    """Return the step of a channel's values, and whether most samples have one of their own."""
    distinct = np.unique(y)
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-12 * float(np.abs(distinct).max())]
    step = float(np.quantile(gaps, 0.01)) if len(gaps) else 0.0
    return step, len(distinct) > 0.5 * len(y)


def unwrapped(x: FloatArray, turn: float) -> tuple[FloatArray, int]:
    """Return an angle without the jumps of a counter that begins anew every turn, and their number.

    Jumps are taken for those of a counter where each is a turn long, but for what the angle moves
    between samples, and the angle stays within a turn. Otherwise the angle comes back as it is.
    """
    known = np.isfinite(x)
    y = x[known]
    if len(y) < FEWEST or np.ptp(y) > 1.02 * turn or np.ptp(y) < 0.7 * turn:
        return x, 0
    d = np.diff(y)
    jumps = np.abs(d) > 0.5 * turn
    if not jumps.any() or np.median(np.abs(d)) > 0.25 * turn:
        return x, 0
    over = -np.sign(d) * jumps
    rest = np.abs(d[jumps] + turn * over[jumps])
    usual = float(np.abs(d[~jumps]).max(initial=0.0))
    if np.quantile(rest, 0.9) > min(max(2.0 * usual, 0.02 * turn), 0.3 * turn):
        return x, 0
    out = x.copy()
    out[known] = y + turn * np.concatenate([[0.0], np.cumsum(over)])
    return out, int(jumps.sum())
