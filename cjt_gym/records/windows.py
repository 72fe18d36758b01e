"""The windows of a long log that tell most about a joint.

A window is worth what it adds: reversals, range of torque and speed, movement at every octave of
frequency, time in each direction at every octave of speed. Each of these counts with diminishing
returns, so that windows are chosen that differ (greedy maximisation of a sum of concave functions:
Nemhauser, Wolsey, Fisher (1978), Mathematical Programming 14, 265-294).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.files import MappingLike, joined
from cjt_gym.records.logs import Log, open_log
from cjt_gym.records.record import Record
from cjt_gym.records.repair import ABSURD
from cjt_gym.records.repair_notes import Repair

LENGTH = 10.0
"""Length of a window [s]."""
FEWEST = 200
"""Samples of a window, however slow the log."""
OCTAVES = 8
"""Octaves below the sampling rate that are told apart."""
DRIVING = ("i", "i_cmd", "tau_m", "tau_cmd", "v")
MOVING = ("q_m", "q_l", "q_g", "dq_m", "dq_l", "tau")
BANDS = np.arange(-40, 41)
"""Octaves of the speed, in any unit, that are told apart."""
FAST = 5
"""Octaves below the fastest of a log that count; further below is noise at rest."""
SEEN = 0.02
"""Share of a window's samples from which an octave of speed counts as reached."""
ENOUGH = 0.2
"""Share of the largest value of a feature in the log at which half of its worth is reached."""

Columns = Mapping[str, FloatArray]


def informative_windows(
    path_or_name: str | Path,
    seconds: float = 60.0,
    length: float = LENGTH,
    mapping: MappingLike | None = None,
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return the windows of a log that tell most, repaired; a short log is returned whole.

    The log is read once, a window at a time, and only a few times the windows asked for are held:
    memory does not grow with the log, and time grows in proportion to it. Windows that follow each
    other are joined.

    Args:
        path_or_name: The log.
        seconds: Length of all windows together [s].
        length: Length of a window [s].
        mapping: Which column is which; see :func:`cjt_gym.records.read_record`.

    Returns:
        The records in the order of the log, and what was repaired or noticed in them.

    Raises:
        RecordError: There is no such log, or nothing in it can be used.
    """
    return windows_of(open_log(path_or_name, mapping), seconds, length)


def windows_of(
    log: Log, seconds: float, length: float = LENGTH
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return the windows of a log that tell most; see :func:`informative_windows`."""
    if not 0.0 < length <= seconds:
        raise RecordError(
            f"The length of a window must be > 0 s and at most the {seconds:g} s of all windows, "
            f"got {length:g} s."
        )
    rows = max(round(length / _sample_time(log)), FEWEST)
    count = max(int(seconds / length), 1)
    read, windows = _best(log.columns(rows), count)
    records: list[Record] = []
    repairs = list(log.notes)
    if len(windows) < read:
        text = (
            f"Of {read} windows of {length:g} s {len(windows)} are used, the most informative: "
            f"those from {', '.join(f'{window.place * length:g}' for window in windows)} s."
        )
        repairs.append(Repair("cut", None, read - len(windows), True, text))
    for columns in _runs(windows):
        made, found = log.records(columns)
        records += made
        repairs += [repair for repair in found if repair not in repairs]
    return tuple(records), tuple(repairs)


class Window(NamedTuple):
    """A window of a log: its place among them, its features, its columns."""

    place: int
    worth: FloatArray
    columns: Columns


def _best(pieces: Iterator[Columns], count: int) -> tuple[int, list[Window]]:
    """Return how many windows there are, and the most telling, in the order of the log."""
    pool: list[Window] = []
    scale, read = np.array(0.0), 0
    for place, columns in enumerate(pieces):
        worth = features(columns)
        scale, read = np.maximum(scale, worth), place + 1
        pool.append(Window(place, worth, columns))
        if len(pool) >= 4 * count:
            pool = _chosen(pool, 2 * count, scale)
    return read, _chosen(pool, count, scale)


def _chosen(pool: list[Window], count: int, scale: FloatArray) -> list[Window]:
    table = np.array([window.worth for window in pool])
    bands = scale[-2 * len(BANDS) :].reshape(2, -1)
    top = max(np.flatnonzero((bands > SEEN).any(axis=0)), default=0)
    slow = np.arange(len(BANDS)) <= top - FAST
    table[:, -2 * len(BANDS) :][:, np.r_[slow, slow]] = 0.0
    return [pool[k] for k in sorted(choose(table, count, scale))]


def features(columns: Columns) -> FloatArray:
    """Return what there is in a window of a log, each >= 0: the more, the more it tells.

    Ranges, speed and reversals of what drives and of what moves, and the deviation at every octave;
    then the time at every octave of speed, in each direction; all of it times the share of samples
    that are there.
    """
    driving = next((name for name in DRIVING if name in columns), "")
    moving = next((name for name in MOVING if name in columns), "")
    parts, shares, y = [], [], np.empty(0)
    for name in (driving, moving):
        x = columns.get(name, np.empty(0))
        y = x[np.abs(x) < ABSURD]
        shares.append(len(y) / max(len(x), 1) if name else 1.0)
        parts += _one(y)
    speed = y if moving.startswith("dq") else np.diff(_smooth(y))
    return np.array([*parts, *_bands(speed)]) * float(np.prod(shares))


def choose(table: FloatArray, count: int, scale: ArrayLike) -> list[int]:
    """Return which windows to take, the most telling first.

    Table and scale hold features >= 0: of each window, and the largest value of each.

    Example:
        >>> choose(np.array([[1.0, 0.0], [0.9, 0.0], [0.0, 0.5]]), 2, [1.0, 0.5])
        [0, 2]
    """
    x = table / np.maximum(scale, 1e-300)
    chosen: list[int] = []
    total = np.zeros(x.shape[1])
    for _ in range(min(count, len(x))):
        worth = ((total + x) / (total + x + ENOUGH)).sum(axis=1)
        worth[chosen] = -1.0
        best = int(np.argmax(worth))
        chosen.append(best)
        total = total + x[best]
    return chosen


def _one(y: FloatArray) -> list[float]:
    """Return the features of one channel: range, speed, reversals and octaves."""
    if len(y) < 2 ** (OCTAVES + 1):
        y = np.pad(y, (0, 2 ** (OCTAVES + 1) - len(y)), mode="edge" if len(y) else "constant")
    low, high = np.quantile(y, [0.01, 0.99])
    speed = np.diff(_smooth(y))
    large = np.abs(speed) > 0.02 * np.abs(speed).max()
    signs = np.sign(speed[large])
    reversals = float(np.sum(signs[1:] != signs[:-1]))
    octaves = []
    for _ in range(OCTAVES):
        y = y[: len(y) // 2 * 2]
        octaves.append(float(np.std(y[1::2] - y[::2])))
        y = 0.5 * (y[1::2] + y[::2])
    return [
        float(high - low),
        float(np.abs(speed).max()),
        np.sqrt(reversals) * (high - low),
        *octaves,
    ]


def _smooth(y: FloatArray) -> FloatArray:
    """Return means of eight samples each."""
    return np.asarray(y[: len(y) // 8 * 8].reshape(-1, 8).mean(axis=1))


def _bands(speed: FloatArray) -> list[float]:
    """Return the share of samples at each octave of speed, forwards, then backwards."""
    octave = np.digitize(np.abs(speed), 2.0 ** BANDS[1:])
    share = 1.0 / max(len(speed), 1)
    ways = (speed > 0.0, speed < 0.0)
    return [n * share for way in ways for n in np.bincount(octave[way], minlength=len(BANDS))]


def _sample_time(log: Log) -> float:
    beginning = next(log.columns(2000), {})
    records, _ = log.records(beginning)
    return float(records[0].dt)


def _runs(windows: list[Window]) -> list[dict[str, FloatArray]]:
    """Return the columns of windows, those that follow each other joined."""
    places = np.array([window.place for window in windows])
    groups = np.split(np.arange(len(windows)), np.flatnonzero(np.diff(places) > 1) + 1)
    return [joined(windows[k].columns for k in group) for group in groups]
