"""Tables as Parquet files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from cjt_gym.disk import COLUMNS
from cjt_gym.disk import NUMBERS as MOST
from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables.flat import NUMBERS
from cjt_gym.records.tables.libraries import library


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return all columns."""
    parquet = library("pyarrow.parquet", path, "parquet")
    with parquet.ParquetFile(path) as file:
        _check_size(path, file.metadata)
        table = file.read()
    _refuse_repeated(path, table.column_names)
    return {name: table.column(name).to_numpy() for name in table.column_names}


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the columns of numbers in pieces of so many rows, without holding the others."""
    arrow = library("pyarrow", path, "parquet")
    parquet = library("pyarrow.parquet", path, "parquet")
    with parquet.ParquetFile(path) as file:
        _check_size(path, file.metadata)
        for batch in file.iter_batches(batch_size=rows):
            _refuse_repeated(path, batch.schema.names)
            columns = zip(batch.schema.names, batch.columns, strict=True)
            arrays = {name: _array(arrow, values) for name, values in columns}
            yield {n: values for n, values in arrays.items() if values.dtype.kind in NUMBERS}


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns."""
    arrow = library("pyarrow", path, "parquet")
    parquet = library("pyarrow.parquet", path, "parquet")
    parquet.write_table(arrow.table(dict(columns)), path)


def _array(arrow: Any, values: Any) -> NDArray[Any]:
    """Return an Arrow array as a NumPy array, times as whole nanoseconds."""
    if arrow.types.is_timestamp(values.type):
        values = values.cast(arrow.timestamp("ns")).cast(arrow.int64())
    array: NDArray[Any] = values.to_numpy(zero_copy_only=False)
    return array


def _check_size(path: Path, metadata: Any) -> None:
    COLUMNS.check(metadata.num_columns, path, RecordError)
    MOST.check(metadata.num_columns * metadata.num_rows, path, RecordError)


def _refuse_repeated(path: Path, names: list[str]) -> None:
    if len(set(names)) != len(names):
        raise RecordError(f"Every column of {path} must have a name of its own.")
