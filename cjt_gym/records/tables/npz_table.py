"""Tables as NumPy archives: one array per column."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables.flat import NUMBERS, flat_arrays

BROKEN = (ValueError, OSError, EOFError, zipfile.BadZipFile, AttributeError)


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return all arrays.

    Raises:
        RecordError: The file is no archive, or holds objects.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except BROKEN as error:
        raise _no_archive(path, error) from error


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield pieces of so many rows, without holding the others; single numbers are left out.

    Raises:
        RecordError: The file is no archive.
    """
    try:
        with ExitStack() as stack:
            archive = stack.enter_context(zipfile.ZipFile(path))
            members = [
                _Member(name.removesuffix(".npy"), stack.enter_context(archive.open(name)))
                for name in archive.namelist()
            ]
            members = [member for member in members if member.is_series]
            longest = max((member.shape[0] for member in members), default=0)
            members = [member for member in members if member.shape[0] > 1 or longest == 1]
            if any(member.shape[0] != longest for member in members):
                rows = longest  # columns with clocks of their own cannot be cut at the same rows
            for _ in range(0, max(longest, 1), max(rows, 1)):
                yield {
                    name: values
                    for member in members
                    for name, values in flat_arrays(member.name, member.next(rows))
                }
    except BROKEN as error:
        raise _no_archive(path, error) from error


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns, compressed."""
    with path.open("wb") as file:
        np.savez_compressed(file, **columns)  # type: ignore[arg-type]


class _Member:
    """An array of an archive that is read row by row."""

    def __init__(self, name: str, file: IO[bytes]) -> None:
        version = np.lib.format.read_magic(file)
        header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        self.name, self.file = name, file
        self.shape, fortran, self.dtype = header(file)
        self.is_series = (self.dtype.kind in NUMBERS and len(self.shape) in (1, 2)) and not (
            fortran and len(self.shape) == 2
        )

    def next(self, rows: int) -> NDArray[Any]:
        width = int(np.prod(self.shape[1:], dtype=int))
        data = self.file.read(rows * width * self.dtype.itemsize)
        return np.frombuffer(data, dtype=self.dtype).reshape(-1, *self.shape[1:])


def _no_archive(path: Path, error: BaseException) -> RecordError:
    return RecordError(f"{path} must be an NPZ archive of plain numeric arrays: {error}.")
