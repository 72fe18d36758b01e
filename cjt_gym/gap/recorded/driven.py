"""Stretches of records in which something other than the motor moves the joint.

On a test bench a second machine may drive the joint while its own motor is off. Nothing there tells
what the motor's torque does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cjt_gym.gap.recorded.series import SHORTEST
from cjt_gym.joint import Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

Flags = NDArray[np.bool_]
INPUTS = ("i_cmd", "tau_cmd", "i", "tau_m")
"""Channels of which each that is recorded is zero while the motor is off."""
OFF, NOISY = 1e-3, 0.1
"""Largest input of a motor that is off, relative to the largest of all records, and largest mean of
a measured current over `OVER`, which may be noisy, beside a command that is off."""
BRIEFEST, OVER = 0.5, 0.1
"""Shortest stretch, and time over which its speeds are averaged [s]."""
FURTHER = 2.0 * np.pi
"""Travel from which no weight explains that the joint speeds up [rad]."""
FASTER = 0.2
"""Gain of speed, relative to the usual one, that is none of noise. Two records of a test bench
gained 1.4 and 1.8 times it over 1300 and 2260 rad; stretches without current in ten records of
other machines at most 0.1 times, over at most 2 rad."""


def driven_only(
    records: Sequence[Record], shape: Structure
) -> tuple[tuple[Record, ...], tuple[str, ...]]:
    """Return records without what others move: the rows are missing (NaN), and a sentence on each.

    A joint is moved by something else where it speeds up over more than a revolution although its
    motor is off, unless a measured torque is what moves it, or the load behind its spring may.

    Args:
        records: Records of one joint, several of which may be pieces of one log.
        shape: Structure of the joint.
    """
    largest: dict[str, float] = {}
    for record in records:
        for name in (n for n in INPUTS if n in record):
            size = float(np.max(np.abs(np.nan_to_num(record[name])), initial=0.0))
            largest[name] = max(size, largest.get(name, 0.0))
    kept, said = [], []
    for record in records:
        for start, stop in _moved_by_others(record, shape, largest):
            outside = (record.t < start) | (record.t > stop)
            columns = {
                name: x if name == "t" else np.where(outside, x, np.nan)
                for name, x in record.columns.items()
            }
            record = replace(record, columns=columns, allow_nan=True)
            said.append(
                f"Between {start:.3g} and {stop:.3g} s the joint speeds up although its motor is "
                "off: something else drives it, and these rows were not used."
            )
        kept.append(record)
    return tuple(kept), tuple(said)


def is_left(record: Record) -> bool:
    """Return whether something is left of a record without what others move."""
    names = (name for name in record.columns if name != "t")
    return any(np.isfinite(record[name]).sum() >= SHORTEST for name in names)


def _moved_by_others(
    record: Record, shape: Structure, largest: Mapping[str, float]
) -> list[tuple[float, float]]:
    """Return the first and last time of each stretch that something else moves [s]."""
    sprung = shape.has_spring and ("tau" in record or not shape.output_fixed)
    known = "tau_l" in record or sprung
    inputs = [name for name in INPUTS if name in record and largest[name] > 0.0]
    if known or record.prismatic or "q_m" not in record or not inputs:
        return []
    seen = np.isfinite(record["q_m"])
    t, q = record.t[seen], record["q_m"][seen]
    if len(t) < 2:
        return []
    off = _is_off({name: record[name][seen] for name in inputs}, largest, record.dt)
    usual = float(np.sqrt(np.mean((np.diff(q) / np.diff(t)) ** 2)))
    edges = np.flatnonzero(np.diff(off, prepend=False, append=False))
    return [
        (float(t[a]), float(t[b - 1]))
        for a, b in pairwise(edges)
        if off[a] and _speeds_up(t[a:b], q[a:b], FASTER * usual)
    ]


def _is_off(inputs: Mapping[str, Floats], largest: Mapping[str, float], dt: float) -> Flags:
    """Return where a motor is off, shape (N,)."""
    commanded = any(name.endswith("_cmd") for name in inputs)
    found = []
    for name, x in inputs.items():
        exact = name.endswith("_cmd") or not commanded
        mean = x if exact else uniform_filter1d(x, max(round(OVER / dt), 1))
        found.append(np.abs(mean) <= (OFF if exact else NOISY) * largest[name])
    return np.asarray(np.all(found, axis=0))


def _speeds_up(t: Floats, q: Floats, least: float) -> bool:
    """Return whether a stretch of motion gains speed over more than a revolution."""
    if t[-1] - t[0] < BRIEFEST or np.ptp(q) < FURTHER:
        return False
    at = np.linspace(t[0], t[-1], int((t[-1] - t[0]) / OVER) + 1)
    speed = np.abs(np.diff(np.interp(at, t, q)) / np.diff(at))
    return bool(np.max(speed - np.minimum.accumulate(speed)) > least)
