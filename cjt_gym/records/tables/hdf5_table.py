"""Tables as HDF5 files, which MATLAB files of version 7.3 are too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import COLUMNS, NUMBERS
from cjt_gym.errors import RecordError
from cjt_gym.records.tables.flat import NUMBERS as REAL
from cjt_gym.records.tables.flat import flat_arrays
from cjt_gym.records.tables.libraries import library

DEEPEST = 32  # groups in groups, far more than logs have


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return every series of numbers, those within a group as ``group.name``."""
    h5py = library("h5py", path, "logs", " Or save it in MATLAB with  save('log.mat', '-v7').")
    columns: dict[str, NDArray[Any]] = {}
    count = 0

    def visit(name: str, item: Any) -> None:
        nonlocal count
        if name.count("/") > DEEPEST:
            raise RecordError(f"{path} must be nested at most {DEEPEST} levels deep.")
        series = isinstance(item, h5py.Dataset) and not name.startswith("#")
        if not series or item.dtype.kind not in REAL or not 1 <= item.ndim <= 2 or item.size < 2:
            return
        _refuse_elsewhere(path, name, item)
        count += item.size
        NUMBERS.check(count, path, RecordError)
        columns.update(flat_arrays(name.replace("/", "."), np.asarray(item)))
        COLUMNS.check(len(columns), path, RecordError)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    if not columns:
        raise RecordError(f"{path} must hold series of numbers, found none.")
    return columns


def _refuse_elsewhere(path: Path, name: str, dataset: Any) -> None:
    """Refuse a dataset whose numbers are in other files, which can be any on this machine."""
    if dataset.external or dataset.is_virtual:
        raise RecordError(
            f"{name} in {path} is stored in other files, which are not read. Copy it into one file:"
            "  h5repack run.h5 whole.h5"
        )
