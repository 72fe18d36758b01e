"""Readers and writers of record files: a table as CSV, Parquet or NPZ, and the TOML file beside it.

Adding a format is one pair of functions and one row of :data:`FORMATS`.
"""

from __future__ import annotations

import csv
import importlib
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.columns import column_of
from cjt_gym.records.metadata import read_metadata, write_metadata
from cjt_gym.records.record import Record

Table = Mapping[str, Any]


@dataclass(frozen=True)
class Format:
    """How the table of a record is read and written.

    Attributes:
        read: Returns the columns of a file.
        write: Writes columns, each of shape (n,), to a file.
    """

    read: Callable[[Path], Table]
    write: Callable[[Mapping[str, FloatArray], Path], None]


def read_record(path_or_name: str | Path, allow_nan: bool = False) -> Record:
    """Read a record from its table or the ``.toml`` beside it, or a shipped one by its name.

    Args:
        path_or_name: ``run.csv``, ``run.npz``, ``run.parquet`` or ``run.toml``, or one of
            :func:`record_names`.
        allow_nan: Whether NaN (an empty cell of a CSV file) stands for a sample that is missing.

    Raises:
        RecordError: There is no such record, or its files are not valid.

    Example:
        >>> record = read_record("emps")
        >>> len(record), record.units["q_m"]
        (24841, 'm')
    """
    table = _table_path(path_or_name)
    facts = read_metadata(table.with_suffix(".toml"))
    columns = _format_of(table).read(table)
    return Record(columns=columns, allow_nan=allow_nan, origin=table, **facts)


def write_record(record: Record, path: str | Path) -> Path:
    """Write a record as a table, its format given by the suffix, and the ``.toml`` beside it.

    Returns:
        Path of the table.

    Raises:
        RecordError: The suffix is not one of :data:`FORMATS`.
    """
    path = Path(path)
    form = _format_of(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    form.write({name: record[name] for name in record.columns}, path)
    write_metadata(record, path.with_suffix(".toml"))
    return path


def record_names() -> tuple[str, ...]:
    """Return the names of the records that ship with the package."""
    return tuple(
        sorted(
            entry.name.removesuffix(".npz")
            for entry in _shipped().iterdir()
            if entry.name.endswith(".npz")
        )
    )


def _shipped() -> Path:
    return Path(str(resources.files("cjt_gym.records"))) / "data"


def _table_path(path_or_name: str | Path) -> Path:
    if str(path_or_name) in record_names():
        return _shipped() / f"{path_or_name}.npz"
    path = Path(path_or_name)
    if path.suffix == ".toml":
        return _table_beside(path)
    if path.is_file():
        return path
    hint = unknown_name("record", str(path_or_name), record_names())
    raise RecordError(f"There is no file {path}. {hint}")


def _table_beside(path: Path) -> Path:
    tables = [table for suffix in FORMATS if (table := path.with_suffix(suffix)).is_file()]
    if len(tables) != 1:
        found = ", ".join(table.name for table in tables) or "none"
        raise RecordError(
            f"Beside {path} there must be exactly one table ({', '.join(FORMATS)}), found {found}. "
            "Name the table."
        )
    return tables[0]


def _format_of(path: Path) -> Format:
    try:
        return FORMATS[path.suffix]
    except KeyError:
        raise RecordError(
            f"The file name of a record must end in {', '.join(FORMATS)}, got {path}."
        ) from None


def _read_csv(path: Path) -> Table:
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = csv.reader(file)
        names = [name.strip() for name in next(rows, [])]
        _check_names(path, names)
        values = [_csv_row(path, rows.line_num, names, row) for row in rows if row]
    table = np.array(values, dtype=np.float64).reshape(-1, len(names))
    return dict(zip(names, table.T, strict=True))


def _csv_row(path: Path, line: int, names: list[str], row: list[str]) -> list[float]:
    if len(row) != len(names):
        raise RecordError(
            f"Line {line} of {path} must have {len(names)} values like its header, got {len(row)}."
        )
    try:
        return [float(cell or "nan") for cell in row]
    except ValueError:
        raise RecordError(
            f"Line {line} of {path} must hold numbers with a decimal point, got {','.join(row)!r}."
        ) from None


def _check_names(path: Path, names: list[str]) -> None:
    for name in names:
        column_of(name)
    if not names:
        raise RecordError(f"{path} must begin with a line of column names, got an empty file.")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise RecordError(
            f"Every column of {path} must have a name of its own, got {repeated[0]!r} twice."
        )


def _write_csv(columns: Mapping[str, FloatArray], path: Path) -> None:
    table = np.column_stack(list(columns.values()))
    np.savetxt(
        path,
        table,
        fmt="%.17g",
        delimiter=",",
        header=",".join(columns),
        comments="",
        encoding="utf-8",
    )


def _read_npz(path: Path) -> Table:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, AttributeError) as error:
        raise RecordError(
            f"{path} must be an NPZ archive of plain numeric arrays: {error}."
        ) from error


def _write_npz(columns: Mapping[str, FloatArray], path: Path) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **columns)  # type: ignore[arg-type]


def _read_parquet(path: Path) -> Table:
    arrow, parquet = _pyarrow()
    try:
        table = parquet.read_table(path)
    except (arrow.ArrowException, OSError) as error:
        raise RecordError(f"{path} must be a Parquet file: {error}.") from error
    _check_names(path, table.column_names)
    return {name: table.column(name).to_numpy() for name in table.column_names}


def _write_parquet(columns: Mapping[str, FloatArray], path: Path) -> None:
    arrow, parquet = _pyarrow()
    parquet.write_table(arrow.table(dict(columns)), path)


def _pyarrow() -> tuple[Any, Any]:
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise RecordError(
            "Parquet files need pyarrow, which is not installed. Use .csv or .npz, or "
            "pip install cjt-gym[parquet]."
        ) from error


FORMATS: Final[dict[str, Format]] = {
    ".csv": Format(_read_csv, _write_csv),
    ".parquet": Format(_read_parquet, _write_parquet),
    ".npz": Format(_read_npz, _write_npz),
}
