"""NumPy archives from files that are not trusted."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk.limits import COLUMNS, NUMBERS
from cjt_gym.disk.parsing import parsing
from cjt_gym.errors import CjtGymError

REAL: Final = "fiub"
TEXT: Final = "U"
HEADERS: Final[dict[tuple[int, int], Any]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
ENDING: Final = ".npy"
LAST_LETTER: Final = 0x10FFFF
"""The last of Unicode; Python does not survive strings with others."""


class Member:
    """An array of an archive, of which no more is read than is asked for."""

    def __init__(self, name: str, file: IO[bytes], size: int) -> None:
        """Read its header."""
        shape, self.by_columns, self.dtype = HEADERS[np.lib.format.read_magic(file)](file)
        self.name, self._file = name, file
        self.shape: tuple[int, ...] = shape
        if self.dtype.hasobject:
            raise ValueError(f"{name} holds objects, which are not read")
        if any(not isinstance(n, int) or n < 0 for n in shape):
            raise ValueError(f"{name} has the shape {shape}")
        stored = size - file.tell()
        if self.count * self.dtype.itemsize != stored:
            raise ValueError(f"{name} has the shape {shape}, but {stored} bytes")

    @property
    def count(self) -> int:
        """Numbers in it."""
        return math.prod(self.shape)

    def rows(self, count: int) -> NDArray[Any]:
        """Return the next so many rows of an array that is stored row by row."""
        width = math.prod(self.shape[1:])
        data = self._file.read(count * width * self.dtype.itemsize)
        return np.frombuffer(data, dtype=self.dtype).reshape(-1, *self.shape[1:])

    def all(self) -> NDArray[Any]:
        """Return the whole array, where nothing of it has been read yet."""
        data = self._file.read(self.count * self.dtype.itemsize)
        flat: NDArray[Any] = np.frombuffer(bytearray(data), dtype=self.dtype)
        if self.dtype.kind == TEXT:
            letters = np.frombuffer(data, self.dtype.str[0] + "u4")
            if ((letters > LAST_LETTER) | ((letters >= 0xD800) & (letters < 0xE000))).any():
                raise ValueError(f"{self.name} has characters that do not exist")
        return flat.reshape(self.shape, order="F" if self.by_columns else "C")


@contextmanager
def members_of(path: Path, error: type[CjtGymError]) -> Iterator[list[Member]]:
    """Open the arrays of an archive."""
    with ExitStack() as stack:
        archive = stack.enter_context(zipfile.ZipFile(stack.enter_context(path.open("rb"))))
        entries = archive.infolist()
        COLUMNS.check(len(entries), path, error)
        NUMBERS.check(sum(entry.file_size for entry in entries) // 8, path, error)
        found = []
        for entry in entries:
            file = stack.enter_context(archive.open(entry))
            found.append(Member(entry.filename.removesuffix(ENDING), file, entry.file_size))
        yield found


def read_arrays(path: Path, error: type[CjtGymError]) -> dict[str, NDArray[Any]]:
    """Return all arrays of an archive: real numbers and texts."""
    path.open("rb").close()  # a file that is not there is no malformed one
    what = f"{path} must be an NPZ archive of plain numeric arrays"
    with parsing(what, error), members_of(path, error) as members:
        if strange := [m.name for m in members if m.dtype.kind not in REAL + TEXT]:
            raise ValueError(f"{strange[0]} holds no numbers")
        return {member.name: member.all() for member in members}
