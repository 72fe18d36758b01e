"""The file formats of a record's table. Adding one is a module and a row of :data:`FORMATS`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

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

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Format:
    """How the table of a record is read and written.

    Attributes:
        read: Returns the columns of a file; an error where a value cannot be read.
        stream: Yields them in pieces of that many rows, whatever they are called; values that
            cannot be read are NaN.
        write: Writes columns, each of shape (n,), to a file; None where that is not offered.
    """

    read: Callable[[Path], Table]
    stream: Callable[[Path, int], Iterator[Table]]
    write: Callable[[Mapping[str, FloatArray], Path], None] | None


_CSV: Final = Format(csv_table.read, csv_table.stream, csv_table.write)
_CAN: Final = Format(can_table.read, can_table.stream, None)
_HDF5: Final = Format(hdf5_table.read, hdf5_table.stream, None)

FORMATS: Final[dict[str, Format]] = {
    ".csv": _CSV,
    ".tsv": _CSV,
    ".txt": _CSV,
    ".parquet": Format(parquet_table.read, parquet_table.stream, parquet_table.write),
    ".npz": Format(npz_table.read, npz_table.stream, npz_table.write),
    ".mat": Format(mat_table.read, mat_table.stream, mat_table.write),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mcap": Format(mcap_table.read, mcap_table.stream, mcap_table.write),
    ".log": _CAN,
    ".asc": _CAN,
    ".blf": _CAN,
    ".trc": _CAN,
}


def format_of(path: Path) -> Format:
    """Return the format that the suffix of a file names.

    Raises:
        RecordError: It names none.
    """
    try:
        return FORMATS[path.suffix.lower()]
    except KeyError:
        raise RecordError(
            f"The file name of a record must end in {', '.join(FORMATS)}, got {path}."
        ) from None
