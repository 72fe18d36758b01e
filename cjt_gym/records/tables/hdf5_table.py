"""Tables as HDF5 files, which MATLAB files of version 7.3 are too."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records.tables.flat import flat_arrays, sliced


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every series of numbers, those within a group as ``group.name``.

    Raises:
        RecordError: h5py is not installed, or this is no HDF5 file, or holds no series.
    """
    try:
        h5py = importlib.import_module("h5py")
    except ImportError as error:
        raise RecordError(
            f"{path} is an HDF5 file (as MATLAB files of version 7.3 are) and needs h5py, which is "
            "not installed: pip install cjt-gym[logs]. Or save it in MATLAB with  "
            "save('log.mat', '-v7')."
        ) from error
    columns: dict[str, NDArray[Any]] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#") and item.size > 1:
            columns.update(flat_arrays(name.replace("/", "."), np.asarray(item)))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except OSError as error:
        raise RecordError(f"{path} must be an HDF5 file: {error}.") from error
    if not columns:
        raise RecordError(f"{path} must hold series of numbers, found none.")
    return columns


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the series in pieces of so many rows. The file is read as a whole."""
    return sliced(read(path), rows)
