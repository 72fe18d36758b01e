"""The record of a run, written row by row, so that it is complete whenever the run ends."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, final

from cjt_gym.errors import ConfigurationError
from cjt_gym.records import Record, default_units, read_record, write_record
from cjt_gym.records.formats import writer_of
from cjt_gym.records.metadata import facts_path, write_metadata

SUFFIX = ".csv"
RESERVE = 1 << 16
"""Bytes of disk that are kept until the end, so that a full disk still takes how a run ended."""


class Watcher(Protocol):
    """Observer of a record while it is written."""

    def begin(self, columns: Sequence[str], facts: Mapping[str, Any]) -> None:
        """Called when a record starts, with its columns and metadata."""

    def see(self, row: Sequence[float]) -> None:
        """Called with each row."""

    def end(self, known: Mapping[str, Any]) -> None:
        """Called when it ends, with what is known then, such as the fault."""


@final
class Journal:
    """A record in progress: a CSV file to which every sample is appended at once.

    Each row is handed to the operating system in one call, so it survives this process. The
    metadata is written at the start and again at the end; disk space for that is reserved. A row
    that does not fit on the disk is left out whole. `close` converts the file if another format was
    asked for.

    Attributes:
        path: The CSV file.
    """

    def __init__(
        self,
        path: str | Path,
        columns: Sequence[str],
        dt: float,
        facts: Mapping[str, Any],
        watcher: Watcher | None = None,
    ) -> None:
        """Begin a record.

        Args:
            path: The file, in any format that records are written in.
            columns: Names of its columns, "t" first.
            dt: Control step [s].
            facts: Further arguments of `Record`: joint, structure, versions, provenance, sensors.
            watcher: Receives every row, or None.

        Raises:
            ConfigurationError: The file cannot be written, or exists.
            RecordError: See `refuse_taken`.
        """
        self.wanted = Path(path)
        self.path = self.wanted.with_suffix(SUFFIX)
        self._rows = 0
        self._watcher = watcher
        self._columns, self._dt, self._facts = tuple(columns), dt, dict(facts)
        self._format = ",".join(["%.10g"] * len(columns)) + "\n"
        refuse_taken(self.wanted)
        self._beside = self.path.with_suffix(".toml")
        self._file, self._size = -1, 0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_EXCL
            self._file = os.open(self.path, flags, 0o644)
            self._append(",".join(columns) + "\n")
            self._size = os.fstat(self._file).st_size
            self._reserve = _reserved(self.path.parent)
            self._describe({})
        except OSError as error:
            self._give_up()
            raise ConfigurationError(
                f"The record {self.path} cannot be written: {error}."
            ) from error
        if watcher is not None:
            watcher.begin(columns, facts)

    def write(self, row: Sequence[float]) -> None:
        """Append a sample, with its values in the order of the columns."""
        self._append(self._format % tuple(row))
        self._count()
        if self._watcher is not None:
            self._watcher.see(row)

    @property
    def rows(self) -> int:
        """Rows written so far."""
        self._count()
        return self._rows

    def _count(self) -> None:
        """Count the latest row, also where an interrupt came as it was written."""
        size = os.fstat(self._file).st_size
        self._rows, self._size = self._rows + (size > self._size), size

    def _append(self, line: str) -> None:
        data, size = line.encode(), os.fstat(self._file).st_size
        try:
            if os.write(self._file, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, size)
            raise

    def _give_up(self) -> None:
        """Remove the files of a record that could not be started."""
        if self._file >= 0:
            os.close(self._file)
            self.path.unlink(missing_ok=True)

    def close(self, **known: Any) -> None:
        """End the record; one without a row leaves no file.

        Args:
            **known: Further entries of its provenance, such as the fault that ended it.

        Raises:
            OSError: The final metadata or the converted file does not fit on the disk; the CSV file
                and the initial metadata remain.
        """
        rows, file, self._file = self.rows, self._file, -1
        if self._watcher is not None:
            self._watcher.end(known)
        os.close(self._reserve)
        try:
            os.fsync(file)
        finally:
            os.close(file)
        if not rows:
            self.path.unlink()
            self._beside.unlink()
            return
        self._describe(known)
        if self.wanted.suffix.lower() != SUFFIX:
            write_record(read_record(self.path, allow_nan=True), self.wanted)
            self.path.unlink()

    def _describe(self, known: Mapping[str, Any]) -> None:
        """Write the metadata beside the table, whole or not at all."""
        columns = {name: [0.0] for name in self._columns}
        provenance = {**self._facts.get("provenance", {}), **known}
        units = default_units(self._columns)
        facts = {**self._facts, "provenance": provenance}
        record = Record(columns, units, dt=self._dt, allow_nan=True, **facts)
        write_metadata(record, self._beside)


def refuse_taken(path: Path) -> None:
    """Raise an error if a record's file exists already, or cannot be written by its suffix."""
    writer_of(path)
    for there in (path, path.with_suffix(SUFFIX)):
        if there.exists():
            raise ConfigurationError(
                f"The record {there} already exists and is not overwritten. Give another name, or "
                "move it away."
            )
    facts_path(path)


def _reserved(folder: Path) -> int:
    """Return an open file that occupies `RESERVE` bytes of the disk until it is closed.

    It has no name, so it vanishes with the process however that ends.
    """
    with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        if file.write(bytes(RESERVE)) < RESERVE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.dup(file.fileno())
