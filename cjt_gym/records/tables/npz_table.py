"""Tables as NumPy archives: one array per column."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk.arrays import Member, members_of, read_arrays
from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray
from cjt_gym.records.tables.flat import NUMBERS, flat_arrays


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Return all arrays."""
    return read_arrays(path, RecordError)


def stream(path: Path, rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield pieces of so many rows, without holding the others; single numbers are left out."""
    with members_of(path, RecordError) as found:
        members = [member for member in found if _is_series(member)]
        longest = max((member.shape[0] for member in members), default=0)
        members = [member for member in members if member.shape[0] > 1 or longest == 1]
        if any(member.shape[0] != longest for member in members):
            rows = longest  # columns with clocks of their own cannot be cut at the same rows
        for _ in range(0, max(longest, 1), max(rows, 1)):
            yield {
                name: values
                for member in members
                for name, values in flat_arrays(member.name, member.rows(rows))
            }


def write(columns: Mapping[str, FloatArray], path: Path) -> None:
    """Write columns, compressed."""
    with path.open("wb") as file:
        np.savez_compressed(file, **columns)  # type: ignore[arg-type]


def _is_series(member: Member) -> bool:
    """Whether an array is one series, or several that are stored row by row."""
    plain = member.dtype.kind in NUMBERS and len(member.shape) in (1, 2) and member.count > 0
    return plain and not (member.by_columns and len(member.shape) == 2)
