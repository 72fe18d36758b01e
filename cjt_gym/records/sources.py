"""From the table of a log to the columns of a record, as a mapping says.

Where the rows of a log hold values of different instants, each column moves to the row it belongs
to.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.checks import FloatArray, check_lengths
from cjt_gym.records.columns import COMMANDS, TRUE_PREFIX
from cjt_gym.records.mapping import ColumnMapping, ColumnSource
from cjt_gym.records.tables.flat import NUMBERS
from cjt_gym.records.tables.mcap_table import LOG_TIME, clock_of
from cjt_gym.records.units import UNITS

LONGEST_HOLE = 2.5
"""Distance of samples, in their median, over which a value in between is missing."""
EPOCH = 1e6
"""Time [s] above which the first sample's is taken for a date and counts as zero."""

Table = Mapping[str, NDArray[Any]]
LARGEST = 2.0**62
"""Whole stamps up to which a difference of two is one, too."""


@dataclass(frozen=True)
class Clock:
    """The time base of a record: a column of the log, if any, its unit and the date of its zero.

    Attributes:
        name: Name of the column.
        tick: Its unit [s].
        origin: Date of its zero [s].
    """

    name: str | None
    tick: float
    origin: float


def clock(mapping: ColumnMapping, table: Table, owner: str) -> Clock:
    """Return the time base of a log: that of ``t``, or else of the topic with most messages."""
    if "t" in mapping.columns:
        source = mapping.columns["t"]
        first = _source(mapping, "t", source.source, table, owner)
        return Clock(source.source, source.gain, _origin(first, source.gain))
    names = {clock_of(column.source) for column in mapping.columns.values()} - {None}
    clocks = [name for name in names if name in table]
    if not clocks:
        return Clock(None, 1.0, 0.0)
    busiest = max(sorted(filter(None, clocks)), key=lambda name: len(table[name]))
    tick = UNITS["ns"].factor
    return Clock(busiest, tick, _origin(table[busiest], tick))


def mapped(mapping: ColumnMapping, table: Table, base: Clock, owner: str) -> dict[str, FloatArray]:
    """Return the columns of a record, in SI units on the link side.

    A column with a clock of its own is brought to the record's: commands hold their value, what is
    measured is interpolated between neighbours, and missing (NaN) where these are far apart.
    """
    columns: dict[str, FloatArray] = {}
    t = None
    if base.name is not None:
        t = _seconds(_source(mapping, "t", base.name, table, owner), base.tick, base.origin)
    if t is not None:
        columns["t"] = t
    for name, column in mapping.columns.items():
        if name == "t":
            continue
        raw = _source(mapping, name, column.source, table, owner)
        values = column.gain * (numbers_of(raw, name, owner) - column.offset)
        own = _own_clock(column, base, table)
        if own is not None and t is not None:
            stamps = _source(mapping, name, own, table, owner)
            tick = base.tick if column.time_unit is None else UNITS[column.time_unit].factor
            values = _on_clock(name, _seconds(stamps, tick, base.origin), values, t)
        columns[name] = values
    check_lengths(owner, columns, mapping.owner)
    return columns


def numbers_of(values: NDArray[Any], name: str, owner: str) -> FloatArray:
    """Return the values of a column of a log."""
    if values.dtype.kind == "U":
        texts = values.tolist()
        row = next((k for k, text in enumerate(texts) if not _is_number(text)), 0)
        raise RecordError(
            f"Column {name!r} of {owner} must hold numbers with a decimal point, got {texts[row]!r}"
            f" in row {row + 1}. Write numbers there, or map another column."
        )
    if values.dtype.kind not in NUMBERS or values.ndim != 1:
        raise RecordError(
            f"Column {name!r} of {owner} must hold real numbers, one per row, got the type "
            f"{values.dtype} and the shape {values.shape}."
        )
    return np.asarray(values, dtype=np.float64)


def _is_number(text: str) -> bool:
    try:
        float(text or "nan")
    except ValueError:
        return False
    return True


def _source(
    mapping: ColumnMapping, name: str, source: str, table: Table, owner: str
) -> NDArray[Any]:
    if source not in table:
        raise RecordError(
            f"columns.{name} of {mapping.owner}: {owner} has no such column. "
            f"{unknown_name('column', source, table)}"
        )
    return table[source]


def _own_clock(column: ColumnSource, base: Clock, table: Table) -> str | None:
    """Return the log's column with the time of a column; None where it is that of the record."""
    if column.time is not None:
        return column.time if column.time != base.name else None
    default = clock_of(column.source)
    if default is None or base.name is None or default == clock_of(base.name):
        return None
    topic = default.removesuffix(LOG_TIME)
    alike = topic + base.name.rpartition(":")[2]
    return alike if alike in table else default


def _seconds(stamps: NDArray[Any], tick: float, origin: float) -> FloatArray:
    """Return times [s] from an origin; whole numbers lose nothing where they are large."""
    if stamps.dtype.kind in "iu" and abs(origin / tick) < LARGEST:
        start = round(origin / tick)
        whole = np.asarray(stamps.astype(np.int64) - start, dtype=np.float64)
        return np.asarray(whole * tick, dtype=np.float64)
    return np.asarray(np.asarray(stamps, dtype=np.float64) * tick - origin, dtype=np.float64)


def _origin(stamps: NDArray[Any], tick: float) -> float:
    finite = stamps[np.isfinite(stamps)] if stamps.dtype.kind == "f" else stamps
    first = float(finite[0]) * tick if len(finite) else 0.0
    return first if abs(first) > EPOCH else 0.0


def _on_clock(name: str, own: FloatArray, values: FloatArray, t: FloatArray) -> FloatArray:
    """Return values, taken at times of their own, at the times of the record."""
    if len(own) != len(values):
        raise RecordError(
            f"The time of column {name!r} has {len(own)} samples and the column {len(values)}. "
            "They must be as many."
        )
    good = np.isfinite(own) & np.isfinite(values)
    own, first = np.unique(own[good], return_index=True)
    values = values[good][first]
    if len(own) < 2:
        return np.full(len(t), np.nan)
    before = np.clip(np.searchsorted(own, t, side="right") - 1, 0, len(own) - 2)
    outside = ~((t >= own[0]) & (t <= own[-1]))
    if name.removeprefix(TRUE_PREFIX) in COMMANDS:
        last = np.clip(np.searchsorted(own, t, side="right") - 1, 0, len(own) - 1)
        return np.where(t >= own[0], values[last], np.nan)
    hole = np.diff(own)[before] > LONGEST_HOLE * np.median(np.diff(own))
    exact = np.isin(t, own)
    return np.where(outside | (hole & ~exact), np.nan, np.interp(t, own, values))


def aligned(
    pieces: Iterable[Mapping[str, FloatArray]], late: Mapping[str, float]
) -> Iterator[dict[str, FloatArray]]:
    """Yield the pieces of a log with late columns moved to earlier rows, early ones to later.

    Rows at either end of the log that lack one of the columns then are left out.
    """
    ahead = max((ceil(x) for x in late.values() if x > 0.0), default=0)
    behind = max((ceil(-x) for x in late.values() if x < 0.0), default=0)
    kept: dict[str, FloatArray] = {}
    some = False
    for piece in pieces:
        table = {n: np.concatenate([kept[n], x]) if kept else x for n, x in piece.items()}
        count = len(next(iter(table.values()), ())) - ahead - behind
        if not late or count > 0:
            some = True
            yield {n: _moved(x, late.get(n, 0.0), behind, count) for n, x in table.items()}
        kept = {n: x[max(count, 0) :] for n, x in table.items()} if late else {}
    if late and not some:
        raise RecordError(
            f"samples_late moves columns by up to {ahead + behind} rows, and the log has no more. "
            "Correct it, or take a longer log."
        )


def _moved(x: FloatArray, late: float, behind: int, count: int) -> FloatArray:
    """Return the rows of a column from one row on, moved; between rows it is interpolated."""
    first = behind + floor(late)
    share = late - floor(late)
    near = x[first : first + count]
    return near if share == 0.0 else (1.0 - share) * near + share * x[first + 1 :][:count]
