"""Raw logs: read in pieces, mapped, repaired."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.columns import COLUMNS, TRUE_PREFIX, default_units
from cjt_gym.records.draft import draft
from cjt_gym.records.files import (
    ROWS,
    MappingLike,
    facts_of,
    joined,
    mapping_of,
    table_path,
)
from cjt_gym.records.formats import Table, format_of
from cjt_gym.records.mapping import SUFFIX, ColumnMapping
from cjt_gym.records.metadata import describes_record, read_metadata
from cjt_gym.records.record import Record
from cjt_gym.records.repair import make_records
from cjt_gym.records.repair_notes import Repair
from cjt_gym.records.sources import Clock, aligned, clock, mapped, numbers_of

SAME_GEAR = 1e-3
"""Relative difference of two gear ratios up to which they are the same but for rounding."""


@dataclass(frozen=True)
class Log:
    """A log in a file, of which only the beginning has been read.

    Without a mapping its columns have the names of a record, and it has no clock.
    """

    path: Path
    mapping: ColumnMapping | None
    clock: Clock | None
    facts: Mapping[str, Any]
    notes: tuple[Repair, ...]

    @property
    def turns(self) -> dict[str, float]:
        """What the counters of angles cover, where the mapping tells."""
        columns = {} if self.mapping is None else self.mapping.columns
        return {name: column.turn for name, column in columns.items() if column.turn}

    def columns(self, rows: int) -> Iterator[dict[str, FloatArray]]:
        """Yield the columns in SI units, in pieces of so many rows of the file."""
        pieces = map(self._in_si, format_of(self.path).stream(self.path, rows))
        return aligned(pieces, {} if self.mapping is None else self.mapping.late)

    def records(
        self, columns: Mapping[str, FloatArray]
    ) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
        """Return the records that columns of the log make, and what was repaired."""
        return make_records(dict(columns), {**self.facts, "origin": self.path}, self.turns)

    def _in_si(self, table: Table) -> dict[str, FloatArray]:
        if self.mapping is not None and self.clock is not None:
            return mapped(self.mapping, table, self.clock, str(self.path))
        used = [name for name in table if name in self.facts["units"]]
        return {name: numbers_of(np.asarray(table[name]), name, str(self.path)) for name in used}


def open_log(
    path_or_name: str | Path, mapping: MappingLike | None = None, n: float | None = None
) -> Log:
    """Return a log, of which only the beginning has been read; arguments as for `read_log`."""
    path = table_path(path_or_name)
    chosen = mapping_of(path, mapping, n)
    beginning = next(iter(format_of(path).stream(path, ROWS)), {})
    if chosen is not None:
        facts = facts_of(path, chosen)
        base = clock(chosen, beginning, str(path))
        if base.name is not None:
            facts["units"] = default_units(("t",)) | facts["units"]
        return Log(path, chosen, base, facts, _other_gear(chosen, n))
    if describes_record(path.with_suffix(".toml")):
        facts = read_metadata(path.with_suffix(".toml"))
        given, there = facts["units"], _of_a_record(beginning)
        absent = [name for name in given if name not in beginning]
        unitless = [name for name in there if name not in given]
        facts["units"] = {n: u for n, u in given.items() if n in beginning}
        facts["units"] = default_units(tuple(unitless)) | facts["units"]
        own = f"{path.stem}.toml"
        notes = [
            Repair(kind, None, len(names), False, f"{text}: {', '.join(names)}.")
            for kind, names, text in (
                ("missing", absent, f"Columns named in {own} but not there"),
                ("unit", unitless, f"Columns taken as SI units, for which {own} has none"),
            )
            if names
        ]
        return Log(path, None, None, facts, tuple(notes))
    return _unexplained(path, list(beginning))


def read_log(
    path_or_name: str | Path,
    mapping: MappingLike | None = None,
    seconds: float | None = None,
    n: float | None = None,
) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    """Read a raw log, and repair it.

    Rows are put in order, a log is cut where its clock was set back or rows are missing for long,
    and samples that cannot be true become NaN; every such thing is listed. Without a mapping and
    without a ``.toml`` beside the log, columns with the names of a record are taken as SI.

    Args:
        path_or_name: The log, in one of :data:`cjt_gym.records.FORMATS`, or a shipped record.
        mapping: Which column is which; see :func:`cjt_gym.records.read_record`.
        seconds: Of a longer log, only its most informative windows of so many seconds in all
            [s]; see :func:`cjt_gym.records.informative_windows`.
        n: Gear ratio, used where the mapping gives none; by default that of the joint it names.

    Returns:
        A record per piece of the log, and what was repaired or noticed.

    Raises:
        RecordError: There is no such log, or nothing in it can be used.

    Example:
        >>> records, repairs = read_log("emps")
        >>> len(records), len(repairs)
        (1, 0)
    """
    log = open_log(path_or_name, mapping, n)
    if seconds is not None:
        from cjt_gym.records.windows import windows_of

        return windows_of(log, seconds)
    records, repairs = log.records(joined(log.columns(ROWS)))
    return records, (*log.notes, *repairs)


def iter_record(
    path_or_name: str | Path, rows: int = ROWS, mapping: MappingLike | None = None
) -> Iterator[Record]:
    """Yield a long log in repaired pieces of at most so many rows, one at a time in memory.

    MATLAB, HDF5 and MCAP files are read as a whole; all others piece by piece.

    Args:
        path_or_name: The log.
        rows: Rows of a piece.
        mapping: Which column is which; see :func:`cjt_gym.records.read_record`.

    Raises:
        RecordError: As for :func:`read_log`.
    """
    if rows < 1:
        raise RecordError(f"rows must be >= 1, got {rows}.")
    log = open_log(path_or_name, mapping)
    for columns in log.columns(rows):
        records, _ = log.records(columns)
        yield from records


def draft_mapping(path_or_name: str | Path) -> str:
    """Return a mapping to be edited, guessed from the names of the columns of a log."""
    path = table_path(path_or_name)
    return draft(path.name, next(iter(format_of(path).stream(path, ROWS)), {}))


def _other_gear(mapping: ColumnMapping, n: float | None) -> tuple[Repair, ...]:
    """Return a note where a mapping converts by another gear ratio than that of the joint."""
    if n is None or mapping.n is None or abs(mapping.n - n) <= SAME_GEAR * abs(n):
        return ()
    text = f"{mapping.owner} converts by a gear ratio of {mapping.n:g}; that of the joint is {n:g}."
    return (Repair("unit", None, 1, False, text),)


def _of_a_record(names: Iterable[str]) -> tuple[str, ...]:
    """Return which columns of a table have the name of a record's column."""
    return tuple(name for name in names if name.removeprefix(TRUE_PREFIX) in COLUMNS)


def _unexplained(path: Path, names: list[str]) -> Log:
    """Return a log of which nothing but the names of its columns is known."""
    known = _of_a_record(names)
    if set(known) <= {"t"}:
        listing = ", ".join(names[:40]) + (", ..." if len(names) > 40 else "")
        raise RecordError(
            f"No column of {path} has the name of a record's column ({', '.join(COLUMNS)}). "
            f"Columns there: {listing or 'none'}. Say which is which in a mapping beside it, or "
            "give that of another log as --mapping FILE (mapping= in Python); a draft to edit:  "
            f"cjt-gym convert {path} --out {path.with_suffix(SUFFIX)}"
        )
    others = [name for name in names if name not in known]
    left = f" Left out: {', '.join(others)}." if others else ""
    text = f"Nothing beside {path.name} says its units: {', '.join(known)} taken as SI units.{left}"
    note = Repair("unit", None, len(known), False, text)
    return Log(path, None, None, {"units": default_units(known)}, (note,))
