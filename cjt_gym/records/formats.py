"""The file formats of a record's table. Adding one is a module and a row of :data:`FORMATS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from cjt_gym.disk import COLUMNS, NUMBERS, parsed_each, parsing
from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables import (
    can_table,
    csv_table,
    hdf5_table,
    mat_table,
    mcap_table,
    npz_table,
    parquet_table,
)
from cjt_gym.records.tables.flat import sliced

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Format:
    """How the table of a record is read and written.

    Reading fails where a value cannot be read. A streamer yields pieces of so many rows, whatever
    columns are called, with NaN for what cannot be read; without one a file is read as a whole.
    """

    what: str
    reader: Callable[[Path], Table]
    streamer: Callable[[Path, int], Iterator[Table]] | None = None
    write: Callable[[Mapping[str, FloatArray], Path], None] | None = None

    def read(self, path: Path) -> Table:
        """Return the columns of a file."""
        with parsing(f"{path} must be {self.what}", RecordError):
            return _checked(path, self.reader(path))

    def stream(self, path: Path, rows: int) -> Iterator[Table]:
        """Yield the columns of a file in pieces of so many rows."""

        def pieces() -> Iterator[Table]:
            stream = self.streamer or (lambda path, rows: sliced(self.reader(path), rows))
            for piece in stream(path, rows):
                yield _checked(path, piece)

        return parsed_each(pieces(), f"{path} must be {self.what}", RecordError)


def _checked(path: Path, table: Table) -> Table:
    COLUMNS.check(len(table), path, RecordError)
    NUMBERS.check(sum(map(len, table.values())), path, RecordError)
    return table


_CSV: Final = Format(
    "a table of numbers as text in UTF-8", csv_table.read, csv_table.stream, csv_table.write
)
_CAN: Final = Format("a trace of a CAN bus", can_table.read)
_HDF5: Final = Format("an HDF5 file", hdf5_table.read)

FORMATS: Final[dict[str, Format]] = {
    ".csv": _CSV,
    ".tsv": _CSV,
    ".txt": _CSV,
    ".parquet": Format(
        "a Parquet file", parquet_table.read, parquet_table.stream, parquet_table.write
    ),
    ".npz": Format(
        "an NPZ archive of plain numeric arrays", npz_table.read, npz_table.stream, npz_table.write
    ),
    ".mat": Format("a MATLAB file of version 4 to 7.3", mat_table.read, write=mat_table.write),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mcap": Format("an MCAP file", mcap_table.read, write=mcap_table.write),
    ".log": _CAN,
    ".asc": _CAN,
    ".blf": _CAN,
    ".trc": _CAN,
}


def writer_of(path: Path) -> Callable[[Mapping[str, FloatArray], Path], None]:
    """Return what writes the format that the suffix of a file names.

    Raises:
        RecordError: The suffix is not one of :data:`FORMATS`, or one that is only read.
    """
    form = FORMATS.get(path.suffix.lower())
    write = None if form is None else form.write
    if write is None:
        able = ", ".join(suffix for suffix, form in FORMATS.items() if form.write is not None)
        raise RecordError(
            f"The file name of a record to be written must end in {able}, got {path}."
        )
    return write


def format_of(path: Path) -> Format:
    """Return the format that the suffix of a file names."""
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise RecordError(
            f"The file name of a record must end in {', '.join(FORMATS)}, got {path}."
        ) from None
