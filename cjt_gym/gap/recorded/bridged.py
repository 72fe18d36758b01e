"""Short gaps in which little happens, filled by interpolation.

A logger that drops a few rows every now and then leaves no stretch of half a second. Where the
input changes slowly, what it did in such a gap is known all the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from cjt_gym.gap.recorded.series import HOLE
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record
from cjt_gym.records.repair_notes import counted

INPUTS = ("i", "i_cmd", "v", "tau_cmd", "tau_m", "tau_l")
"""Channels that must change slowly."""
LONGEST = 0.06
"""Longest gap that is filled [s]: what a motion may do meanwhile is little of what it does within a
tenth of a second."""
SLOWLY = 0.2
"""Largest error of the interpolated input elsewhere in the record, relative to its deviation; it
includes the noise of a measured current."""


def bridged(records: Sequence[Record]) -> tuple[tuple[Record, ...], tuple[str, ...]]:
    """Return records with their short gaps filled, and a sentence on each that had some.

    A gap is filled where interpolation over one as long, tried in the rest of the record,
    reproduces the inputs. Nothing else of the record is changed.
    """
    kept, said = [], []
    for record in records:
        longest = _longest(record)
        gaps = np.diff(record.t)
        short = gaps[(gaps > HOLE * record.dt) & (gaps <= longest)]
        if short.size:
            record = _filled(record, longest)
            said.append(
                f"{counted(short.size, 'gap')} of up to {1e3 * short.max():.2g} ms filled by "
                "interpolation, as the input changes little in so short a time."
            )
        kept.append(record)
    return tuple(kept), tuple(dict.fromkeys(said))


def _longest(record: Record) -> float:
    """Return the longest gap to fill [s]; 0 if there is none."""
    gaps = np.diff(record.t)
    gaps = gaps[(gaps > HOLE * record.dt) & (gaps <= LONGEST)]
    inputs = [record[name] for name in INPUTS if name in record]
    if not gaps.size or not inputs:
        return 0.0
    longest = float(gaps.max())
    return longest if all(_is_slow(record.t, x, longest) for x in inputs) else 0.0


def _is_slow(t: Floats, x: Floats, length: float) -> bool:
    """Return whether interpolation over a time [s] reproduces a channel."""
    known = np.isfinite(x)
    t, x = t[known], x[known]
    inside = (t > t[0] + length) & (t < t[-1] - length) if len(t) else known[:0]
    if not inside.any():
        return False
    ends = [np.interp(t[inside] + k * length, t, x) for k in (-0.5, 0.5)]
    error = x[inside] - np.mean(ends, axis=0)
    return bool(np.sqrt(np.mean(error**2)) <= SLOWLY * np.std(x))


def _filled(record: Record, longest: float) -> Record:
    """Return a record with rows in its gaps up to a length [s]."""
    t, dt = record.t, record.dt
    gaps = np.diff(t)
    parts = [t]
    for k in np.flatnonzero((gaps > HOLE * dt) & (gaps <= longest)):
        parts.append(np.linspace(t[k], t[k + 1], round(gaps[k] / dt) + 1)[1:-1])
    times = np.sort(np.concatenate(parts))
    new = ~np.isin(times, t)
    columns: dict[str, Floats] = {"t": times}
    for name in (n for n in record.columns if n != "t"):
        x = np.full(len(times), np.nan)
        x[~new] = record[name]
        known = np.isfinite(record[name])
        if known.sum() > 1:
            smooth = name.startswith("q_")
            inner = new & (times > t[known][0]) & (times < t[known][-1])
            x[inner] = (
                PchipInterpolator(t[known], record[name][known])(times[inner])
                if smooth
                else np.interp(times[inner], t[known], record[name][known])
            )
        columns[name] = x
    return replace(record, columns=columns, allow_nan=True)
