"""Logs made into records: rows in order, false samples marked as missing, and every change listed.

No value is invented. Impossible values become NaN, which the users of a record treat
as not measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from math import pi
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray, check_lengths
from cjt_gym.records.columns import TRUE_PREFIX
from cjt_gym.records.doubts import doubts
from cjt_gym.records.glitches import (
    COMMON,
    LONGEST_FREEZE,
    LONGEST_GLITCH,
    frozen,
    glitches,
    held,
    stale,
    stuck,
    unwrapped,
)
from cjt_gym.records.record import Record
from cjt_gym.records.repair_notes import Repair, counted, share
from cjt_gym.records.timing import Piece, ordered_rows

MEASURED = ("i", "i_d", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
"""Channels of sensors, in which a single false sample can be told."""
INERT = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
"""Those that masses keep from jumping."""
PULSED_BY = ("i_cmd", "tau_cmd", "v")
"""Columns whose pulses make those of the current."""
LIKE_ITS_COMMAND = 3.0
"""Pulse of a current, in its spread, over that of its command in its own up to which it is one."""
ABSURD = 1e12
"""Size from which a value is none, in any unit; infinity is beyond."""
JUMP = 3.0
"""Jump after rows that repeat, over the largest move within a row, from which a log stood still."""
SHUFFLED = 0.1
"""Usual step of the time, relative to its span, from which rows are in no order."""
SHORTEST = 100
"""Samples below which a piece of a log is left out."""
NOTE = "repairs"
"""Entry of a record's provenance with the sentences of what was done to it."""

Columns = dict[str, FloatArray]
Bools = NDArray[np.bool_]
_NOTHING = Piece(np.empty(0, int), np.empty(0))


def clean(record: Record) -> tuple[Record, tuple[Repair, ...]]:
    """Return a record without what cannot be true, and what was done.

    Of a record with long gaps the longest piece is returned; :func:`clean_pieces` returns all.
    A record that needs nothing comes back as it is.

    Example:
        >>> t = np.arange(400) * 1e-3
        >>> q_m = np.sin(10 * t)
        >>> q_m[200] = 7.0
        >>> record, repairs = clean(Record({"t": t, "q_m": q_m}, {"t": "s", "q_m": "rad"}))
        >>> float(record["q_m"][200]), repairs[0].text
        (nan, 'q_m: 1 glitch (0.25 %) marked as missing.')
    """
    pieces, repairs = clean_pieces(record)
    longest = max(pieces, key=len)
    if len(pieces) > 1:
        text = f"Of {len(pieces)} pieces the longest is kept, {longest.t[-1] - longest.t[0]:.4g} s."
        repairs = (*repairs, Repair("cut", None, len(pieces) - 1, True, text))
    return longest, repairs


def clean_pieces(record: Record) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return the pieces of a record between its gaps, without what cannot be true."""
    columns = {name: record[name] for name in record.columns}
    facts = {field.name: getattr(record, field.name) for field in fields(Record)}
    made, repairs = make_records(columns, facts, {})
    unchanged = len(made) == 1 and not any(repair.changed for repair in repairs)
    return (record,) if unchanged else made, repairs


def make_records(
    columns: Columns, facts: Mapping[str, Any], turns: Mapping[str, float]
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Return records of columns in SI units, whatever their times and values, and what was done.

    Facts are the arguments of :class:`Record` but its columns; turns what counters of angles cover.
    """
    owner = str(facts.get("origin") or "the log")
    if not columns or not _length(columns):
        raise RecordError(f"{owner} has no samples. Check that it was recorded and copied whole.")
    check_lengths(owner, columns)
    pieces, repairs = _in_order(columns, owner)
    marked = [_marked(piece, turns) for piece in pieces]
    repairs += _summed([repair for _, found in marked for repair in found])
    longest = max((piece for piece, _ in marked), key=_length)
    repairs += doubts(longest, _dt(longest, facts))
    texts = [repair.text for repair in repairs]
    return tuple(_record(piece, facts, texts) for piece, _ in marked), tuple(repairs)


def _record(columns: Columns, facts: Mapping[str, Any], texts: list[str]) -> Record:
    missing = any(np.isnan(values).any() for values in columns.values())
    known = dict(facts.get("provenance", {}))
    before = [text for text in known.get(NOTE, []) if text not in texts]
    changes: dict[str, Any] = {"columns": columns}
    changes["allow_nan"] = facts.get("allow_nan", False) or missing
    if before or texts:
        changes["provenance"] = {**known, NOTE: [*before, *texts]}
    return Record(**{**facts, **changes})


def _length(columns: Columns) -> int:
    return len(next(iter(columns.values())))


def _dt(columns: Columns, facts: Mapping[str, Any]) -> float:
    if "t" in columns and len(columns["t"]) > 1:
        return float(np.median(np.diff(columns["t"])))
    dt = facts.get("dt")
    return float(dt) if isinstance(dt, int | float) else 1.0


def _in_order(columns: Columns, owner: str) -> tuple[list[Columns], list[Repair]]:
    if "t" not in columns:
        return [dict(columns)], []
    known = columns["t"][np.isfinite(columns["t"])]
    steps = np.diff(known)
    if len(steps) > SHORTEST and np.median(np.abs(steps)) > SHUFFLED * np.ptp(known):
        back = float(np.mean(steps < 0.0))
        raise RecordError(
            f"The time t of {owner} must increase from row to row, but goes back in "
            f"{100.0 * back:.0f} % of the rows: they are in disorder, or t is another column. Sort "
            "the rows by time, or map the right column to t."
        )
    found, repairs = ordered_rows(columns["t"], _same_rows(columns))
    used = [piece for piece in found if len(piece.t) >= SHORTEST]
    if not used:
        used = [max(found, key=lambda piece: len(piece.t), default=_NOTHING)]
    if len(used[0].t) < 2:
        raise RecordError(
            f"The time t of {owner} must increase from row to row, but fewer than two rows have a "
            "readable time that does. Check that every line holds as many numbers as there are "
            "names; map the right column to t, or leave t out and give dt = ... [s]."
        )
    if lost := sum(len(piece.t) for piece in found) - sum(len(piece.t) for piece in used):
        text = f"{counted(lost, 'row')} in pieces of fewer than {SHORTEST} left out."
        repairs.append(Repair("cut", None, lost, True, text))
    if len(used) == 1 and np.array_equal(used[0].t, columns["t"]):
        return [dict(columns)], repairs
    return [
        {name: piece.t if name == "t" else values[piece.rows] for name, values in columns.items()}
        for piece in used
    ], repairs


def _same_rows(columns: Columns) -> Bools:
    same = np.ones(_length(columns), dtype=bool)
    for values in columns.values():
        same[1:] &= values[1:] == values[:-1]
    same[0] = False
    return same


def _marked(columns: Columns, turns: Mapping[str, float]) -> tuple[Columns, list[Repair]]:
    """Return the columns of a piece with false samples marked as missing."""
    out, repairs = dict(columns), []
    for name, values in columns.items():
        if name == "t":
            continue
        if count := int(np.sum(absurd := np.abs(values) > ABSURD)):
            out[name] = np.where(absurd, np.nan, values)
            repairs.append(_repair("unreadable", name, count, len(values), "impossible value"))
        elif count := int(np.sum(np.isnan(values))):
            text = f"{name}: {share(count, len(values))} of the samples are missing."
            repairs.append(Repair("missing", name, count, False, text))
    for name in sorted(set(INERT) & set(out)):
        if name.startswith("q_"):
            out[name], repair = _unwrapped(name, out[name], turns)
            repairs += repair
    repairs += _mark_stale(out)
    for name in sorted(set(MEASURED) & set(out)):
        false = glitches(out[name], angle=name.startswith("q_")) & ~_pulses(name, out)
        if count := int(false.sum()):
            out[name] = np.where(false, np.nan, out[name])
            repairs.append(_repair("glitch", name, count, len(false), "glitch"))
    return out, repairs


def _repair(kind: str, name: str, count: int, total: int, one: str) -> Repair:
    what = counted(count, one).replace("glitchs", "glitches")
    text = f"{name}: {what} ({share(count, total)}) marked as missing."
    return Repair(kind, name, count, True, text)


def _unwrapped(
    name: str, values: FloatArray, turns: Mapping[str, float]
) -> tuple[FloatArray, list[Repair]]:
    for turn in (turns.get(name, 0.0), 2.0 * pi):
        if turn > 0.0:
            result, jumps = unwrapped(values, turn)
            if jumps:
                text = f"{name}: {counted(jumps, 'jump')} of a turn ({turn:.4g}) taken out."
                return result, [Repair("wrap", name, jumps, True, text)]
    return values, []


def _pulses(name: str, columns: Columns) -> Bools:
    """Return where a current may well be off for a moment, as its command is by about as much.

    Both are measured in their usual spread, as a command may be a voltage or a torque.
    """
    x = columns[name]
    near = np.zeros(len(x), dtype=bool)
    if name in INERT or not np.isfinite(x).any():
        return near
    off = np.abs(x - np.nanmedian(x)) / _spread(x)
    for command in set(PULSED_BY) & set(columns):
        u = columns[command]
        if not np.isfinite(u).any():
            continue
        changes = np.abs(np.diff(u, prepend=u[0])) / _spread(u)
        after, before = 8, 1  # rows that a pulse may last, and lead its command
        around = np.pad(np.nan_to_num(changes), (after - 1, before))
        largest = sliding_window_view(around, after + before).max(axis=1)
        near |= off < LIKE_ITS_COMMAND * largest
    return near


def _spread(x: FloatArray) -> float:
    """Return the usual spread of a channel, or its range where it hardly ever changes."""
    low, high = np.nanquantile(x, (0.02, 0.98))
    return max(float(high - low), 0.05 * float(np.nanmax(x) - np.nanmin(x)), 1e-300)


def _mark_stuck(columns: Columns) -> list[Repair]:
    """Mark a current of a drive that is off as missing, in place; return what was done."""
    angles = [columns[name] for name in INERT if name in columns and name != "tau"]
    if not angles:
        return []
    moves = np.any([np.diff(x, prepend=x[0]) != 0.0 for x in angles], axis=0)
    repairs = []
    for name in sorted({"i", "i_d", "tau"} & set(columns)):
        rows = stuck(columns[name], moves)
        if count := int(rows.sum()):
            last = columns[name][np.flatnonzero(rows)[-1]]
            columns[name] = np.where(rows, np.nan, columns[name])
            text = (
                f"{name}: stays {last:.6g} to the last digit while the joint moves, as of a drive "
                f"that is off; {counted(count, 'row')} ({share(count, len(rows))}) marked as "
                "missing."
            )
            repairs.append(Repair("stale", name, count, True, text))
    return repairs


def _mark_stale(columns: Columns) -> list[Repair]:
    """Mark repeated samples of the columns as missing, in place; return what was done."""
    measured = sorted(set(MEASURED) & set(columns))
    if not measured:
        return []
    repairs = _mark_stuck(columns)
    flagged: dict[str, Bools] = {}
    for name in measured:
        if name in INERT:
            slow, period = held(columns[name])
            if period > 1:
                columns[name] = np.where(slow, np.nan, columns[name])
                text = (
                    f"{name}: a new value only every {period} samples; those in between "
                    f"({share(int(slow.sum()), len(slow))}) marked as missing."
                )
                repairs.append(Repair("stale", name, int(slow.sum()), True, text))
                continue
        flagged[name] = stale(columns[name])
    long = np.zeros(_length(columns), dtype=bool)
    for name in flagged:
        long |= frozen(columns[name])
    for name, repeats in flagged.items():  # what froze one channel may have frozen others
        repeats |= long & _same_rows({name: columns[name]})
    same = _same_rows({name: values for name, values in columns.items() if name != "t"})
    whole = _halted_rows(columns, same)
    if len(flagged) > 1:
        whole |= same & np.any(list(flagged.values()), axis=0)
    if count := int(whole.sum()):
        for name in flagged:
            flagged[name] &= ~whole
        for name, values in columns.items():
            if name != "t" and not name.startswith(TRUE_PREFIX):
                columns[name] = np.where(whole, np.nan, values)
        text = (
            f"{counted(count, 'row')} ({share(count, len(whole))}) that repeat the one before "
            "while the joint moves marked as missing."
        )
        repairs.append(Repair("stale", None, count, True, text))
    for name, repeats in flagged.items():
        if count := int(repeats.sum()):
            columns[name] = np.where(repeats, np.nan, columns[name])
            repairs.append(_repair("stale", name, count, len(repeats), "repeated sample"))
    return repairs


def _halted_rows(columns: Columns, rows: Bools) -> Bools:
    """Return which rows repeat the one before for long while the log stood still, not the joint.

    Such logs jump when they go on, further than the joint ever moves within a row.

    Args:
        columns: The columns of the log.
        rows: Which rows repeat the one before in everything but their time, shape (n,).
    """
    edges = np.diff(rows.astype(int), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    length = ends - begins
    long = (length > LONGEST_GLITCH) & (length <= LONGEST_FREEZE) & (ends < len(rows))
    halts = np.zeros(len(rows), dtype=bool)
    if not long.any() or long.sum() > COMMON * len(rows):
        return halts
    for begin, end in zip(begins[long], ends[long], strict=True):
        halts[begin:end] = True
    for name in set(INERT) & set(columns):
        moves = np.abs(np.diff(columns[name], prepend=np.nan))
        after = moves[ends[long]]
        moves[ends[ends < len(rows)]] = np.nan
        if np.isfinite(moves).any() and np.nanmax(after) > JUMP * np.nanmax(moves):
            return halts
    return np.zeros(len(rows), dtype=bool)


def _summed(repairs: list[Repair]) -> list[Repair]:
    """Return the repairs of several pieces, those of one kind and channel as one."""
    first: dict[tuple[str, str | None, bool], list[Repair]] = {}
    for repair in repairs:
        first.setdefault((repair.kind, repair.channel, repair.changed), []).append(repair)
    return [
        group[0]
        if len(group) == 1
        else replace(
            max(group, key=lambda repair: repair.count),
            count=sum(repair.count for repair in group),
            text=f"{max(group, key=lambda r: r.count).text[:-1]} (worst of {len(group)} pieces).",
        )
        for group in first.values()
    ]
