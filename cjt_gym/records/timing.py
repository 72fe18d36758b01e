"""Rows of a log brought into the order of their times."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.records.checks import FloatArray
from cjt_gym.records.repair_notes import Repair, counted, share

LATE_ROWS = 20
"""Rows by which one may be out of order. Where time falls back further, the clock was set anew."""
LONGEST_GAP = 0.25
"""Time without rows [s] over which a log is cut in two."""
GAP_SAMPLES = 50
"""The same in samples, for logs that are slow."""
EVEN = 0.2
"""Deviation of an interval from a whole multiple of the median, relative, that is called even."""
UNEVEN_SHARE = 0.05
"""Share of uneven intervals from which it is worth saying."""
COARSE_SHARE = 0.2
"""Share of rows with the time of the row before from which times are coarse, not rows repeated."""


RESOLUTION = 1e-12
"""Difference of two times that no clock shows: they are the same [s]."""


class Piece(NamedTuple):
    """Rows of a log without a break in time, in their order, and their increasing times [s]."""

    rows: NDArray[np.intp]
    t: FloatArray


def ordered_rows(t: FloatArray, same: NDArray[np.bool_]) -> tuple[list[Piece], list[Repair]]:
    """Return which rows to keep, in order, in one piece per stretch of time without a break.

    `same` says whether a row repeats the one before in all its values.
    """
    repairs: list[Repair] = []
    rows = _readable(t, repairs)
    if count := int(np.sum(same[rows])):
        text = f"{counted(count, 'row')} that repeat the one before left out."
        repairs.append(Repair("repeated", None, count, True, text))
    rows = rows[~same[rows]]
    resets = _resets(t[rows])
    if resets:
        text = f"The clock was set back {counted(len(resets), 'time')}: the log is cut there."
        repairs.append(Repair("cut", None, len(resets), True, text))
    pieces = [_sorted(t, part) for part in np.split(rows, resets)]
    _note_moved(t, np.split(rows, resets), repairs)
    pieces = _increasing(pieces, repairs)
    pieces = _between_gaps(pieces, repairs)
    _note_uneven(pieces, repairs)
    return pieces, repairs


def _readable(t: FloatArray, repairs: list[Repair]) -> NDArray[np.intp]:
    """Return the rows whose time is a number, and not far off those around it."""
    rows = np.flatnonzero(np.isfinite(t))
    if len(rows) > 2 and np.mean(np.diff(t[rows]) < 0.0) > 0.5:
        rows = rows[::-1]
        text = "The log begins with its latest row: its rows were put in the order of time."
        repairs.append(Repair("order", None, len(rows), True, text))
    if len(rows) > 2 * LATE_ROWS and (np.diff(t[rows]) < 0.0).any():
        steps = np.diff(t[rows])
        near = 2 * LATE_ROWS * float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        from scipy.ndimage import median_filter  # takes long to import

        usual = median_filter(t[rows], 2 * LATE_ROWS + 1, mode="nearest")
        rows = rows[np.abs(t[rows] - usual) <= near]
    if lost := len(t) - len(rows):
        why = "without a readable time, or with more or fewer cells than names"
        text = f"{counted(lost, 'row')} {why}, left out."
        repairs.append(Repair("unreadable", None, lost, True, text))
    return rows


def _resets(t: FloatArray) -> list[int]:
    found: list[int] = []
    for k in np.flatnonzero(np.diff(t) < 0.0) + 1:
        before, after = t[max(k - 4 * LATE_ROWS, 0) : k], t[k : k + LATE_ROWS]
        later = int(np.sum(before > np.median(after)))
        new = not found or k - found[-1] > LATE_ROWS
        if new and (later > LATE_ROWS or later == len(before)):
            found.append(int(k))
    return found


def _sorted(t: FloatArray, rows: NDArray[np.intp]) -> Piece:
    rows = rows[np.argsort(t[rows], kind="stable")]
    return Piece(rows, t[rows])


def _note_moved(t: FloatArray, parts: list[NDArray[np.intp]], repairs: list[Repair]) -> None:
    moved = sum(int(np.sum(t[part] < np.maximum.accumulate(t[part]))) for part in parts)
    if moved:
        text = f"{counted(moved, 'row')} out of order put in their place."
        repairs.append(Repair("order", None, moved, True, text))


def _increasing(pieces: list[Piece], repairs: list[Repair]) -> list[Piece]:
    """Return the pieces with times that increase from row to row.

    Where many rows share the time of the one before, the log's times are coarse: these rows are
    spread evenly up to the next time. Where few do, the later ones are left out.
    """
    again = [np.diff(piece.t, prepend=-np.inf) <= RESOLUTION for piece in pieces]
    count, total = sum(int(np.sum(a)) for a in again), sum(len(piece.t) for piece in pieces)
    if not count:
        return pieces
    if count > COARSE_SHARE * total:
        text = "The times of the log are coarser than its rows: rows of one time spread evenly."
        repairs.append(Repair("sampling", None, count, True, text))
        return [_spread(piece, a) for piece, a in zip(pieces, again, strict=True)]
    text = f"{counted(count, 'row')} with the time of another left out."
    repairs.append(Repair("repeated", None, count, True, text))
    return [Piece(p.rows[~a], p.t[~a]) for p, a in zip(pieces, again, strict=True)]


def _spread(piece: Piece, again: NDArray[np.bool_]) -> Piece:
    first = np.flatnonzero(~again)
    if len(first) < 2:
        return Piece(piece.rows[:1], piece.t[:1])
    index = np.arange(first[-1] + 1)  # how long the last time lasts is not known
    return Piece(piece.rows[index], np.interp(index, first, piece.t[first]))


def _between_gaps(pieces: list[Piece], repairs: list[Repair]) -> list[Piece]:
    """Return the pieces between long times without rows."""
    found: list[Piece] = []
    lost = rows = breaks = 0
    longest = 0.0
    for piece in pieces:
        steps = np.diff(piece.t)
        dt = float(np.median(steps)) if len(steps) else 1.0
        long = steps > max(LONGEST_GAP, GAP_SAMPLES * dt)
        lost += int((np.round(steps[~long] / dt) - 1.0).clip(0.0).sum())
        rows += len(piece.t)
        breaks += int(long.sum())
        longest = max(longest, float(steps[long].max(initial=0.0)))
        ends = np.flatnonzero(long) + 1
        halves = zip(np.split(piece.rows, ends), np.split(piece.t, ends), strict=True)
        found += [Piece(part, t) for part, t in halves]
    if 0 < lost < COARSE_SHARE * rows:
        text = f"{counted(lost, 'row')} ({share(lost, lost + rows)}) missing between others."
        repairs.append(Repair("missing", None, lost, False, text))
    if breaks:
        where = "one place" if breaks == 1 else f"{breaks} places"
        text = f"No rows for up to {longest:.3g} s in {where}: the log is cut there."
        repairs.append(Repair("cut", None, breaks, True, text))
    return found


def _note_uneven(pieces: list[Piece], repairs: list[Repair]) -> None:
    steps = np.concatenate([np.diff(piece.t) for piece in pieces]) if pieces else np.empty(0)
    if len(steps) < 10:
        return
    dt = float(np.median(steps))
    off = np.abs(steps / dt - np.round(steps / dt).clip(1.0)) > EVEN
    if np.mean(off) > UNEVEN_SHARE:
        text = (
            f"Sampling is uneven: {share(int(off.sum()), len(off))} of the intervals differ by "
            f"over {100 * EVEN:.0f} % from whole multiples of their median, {1e3 * dt:.4g} ms."
        )
        repairs.append(Repair("sampling", None, int(off.sum()), False, text))
