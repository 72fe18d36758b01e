"""The windows of a long log that tell most about a joint.

A window is worth what it adds: reversals, range of torque and speed, movement at every octave of
frequency, and some rest. Each of these counts with diminishing returns, so that windows are chosen
that differ (greedy maximisation of a sum of concave functions: Nemhauser, Wolsey, Fisher (1978),
Mathematical Programming 14, 265-294).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.files import MappingLike, joined
from cjt_gym.records.logs import Log, open_log
from cjt_gym.records.record import Record
from cjt_gym.records.repairs import Repair

LENGTH = 10.0
"""Length of a window [s]."""
OCTAVES = 8
"""Octaves below the sampling rate that are told apart."""
DRIVING = ("i", "i_cmd", "tau_m", "tau_cmd", "v")
MOVING = ("q_m", "q_l", "q_g", "tau")
ENOUGH = 0.2
"""Share of the largest value of a feature in the log at which half of its worth is reached."""


def informative_windows(
    path_or_name: str | Path,
    seconds: float = 60.0,
    length: float = LENGTH,
    mapping: MappingLike | None = None,
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return the windows of a log that tell most, repaired; a short log is returned whole.

    The log is read twice, a window at a time, so that memory does not grow with it and time grows
    in proportion to it. Windows that follow each other are joined.

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
    rows = max(round(length / _sample_time(log)), 2)
    table = np.array([features(columns) for columns in log.columns(rows)])
    count = max(int(seconds / length), 1)
    chosen = sorted(choose(table, count))
    records: list[Record] = []
    repairs = list(log.notes)
    if len(chosen) < len(table):
        text = (
            f"Of {len(table)} windows of {length:g} s the {len(chosen)} most informative are used: "
            f"those from {', '.join(f'{k * length:g}' for k in chosen)} s."
        )
        repairs.append(Repair("cut", None, len(table) - len(chosen), True, text))
    for columns in _runs(log, rows, chosen):
        made, found = log.records(columns)
        records += made
        repairs += [repair for repair in found if repair not in repairs]
    return tuple(records), tuple(repairs)


def features(columns: Mapping[str, FloatArray]) -> FloatArray:
    """Return what there is in a window of a log, each >= 0: the more, the more it tells.

    Ranges and reversals of what drives and of what moves, the deviation at every octave, and the
    share of rest; all of it times the share of samples that are there.
    """
    driving = next((columns[name] for name in DRIVING if name in columns), None)
    moving = next((columns[name] for name in MOVING if name in columns), None)
    parts, shares = [], []
    for x in (driving, moving):
        y = np.empty(0) if x is None else x[np.isfinite(x)]
        shares.append(1.0 if x is None else len(y) / max(len(x), 1))
        parts += _one(y)
    return np.array(parts) * float(np.prod(shares))


def choose(table: FloatArray, count: int) -> list[int]:
    """Return which windows to take, the most telling first.

    Args:
        table: Features of the windows, shape (windows, features), >= 0.
        count: Most windows to take.

    Example:
        >>> choose(np.array([[1.0, 0.0], [0.9, 0.0], [0.0, 0.5]]), 2)
        [0, 2]
    """
    x = table / np.maximum(table.max(axis=0), 1e-300)
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
    """Return the features of one channel: range, speed, reversals, rest, and octaves."""
    if len(y) < 2 ** (OCTAVES + 1):
        y = np.pad(y, (0, 2 ** (OCTAVES + 1) - len(y)), mode="edge") if len(y) else _STILL
    low, high = np.quantile(y, [0.01, 0.99])
    smooth = y[: len(y) // 8 * 8].reshape(-1, 8).mean(axis=1)
    speed = np.diff(smooth)
    large = np.abs(speed) > 0.02 * np.abs(speed).max()
    signs = np.sign(speed[large])
    reversals = float(np.sum(signs[1:] != signs[:-1]))
    rest = float(np.mean(np.abs(speed) <= 0.01 * max(np.abs(speed).max(), 1e-300)))
    octaves = []
    for _ in range(OCTAVES):
        y = y[: len(y) // 2 * 2]
        octaves.append(float(np.std(y[1::2] - y[::2])))
        y = 0.5 * (y[1::2] + y[::2])
    moved = high > low
    return [
        float(high - low),
        float(np.abs(speed).max()),
        np.sqrt(reversals) * (high - low),
        min(rest, 0.2) if moved else 0.0,
        *octaves,
    ]


_STILL = np.zeros(2 ** (OCTAVES + 1))


def _sample_time(log: Log) -> float:
    """Return the sample time of a log from its beginning [s]."""
    beginning = next(log.columns(2000), {})
    records, _ = log.records(beginning)
    return float(records[0].dt)


def _runs(log: Log, rows: int, chosen: list[int]) -> list[dict[str, FloatArray]]:
    """Return the columns of the chosen windows, those that follow each other joined."""
    runs: list[list[dict[str, FloatArray]]] = []
    last = -2
    for k, columns in enumerate(log.columns(rows)):
        if k > chosen[-1]:
            break
        if k in chosen:
            if k != last + 1:
                runs.append([])
            runs[-1].append(columns)
            last = k
    return [joined(run) for run in runs]
