"""Nested data as plain columns: fields are joined by dots, items of a list by brackets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

NUMBERS = "fiub"
LONGEST = 1000
"""Characters of a name."""
WIDEST = 64
"""Columns of a two-dimensional array up to which each of them is a channel."""


def flat_arrays(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield every series of numbers in a value, with its name; single numbers are left out.

    An array of shape (n, k) gives k columns ``name[0]`` and so on, and so does one of shape (k, n)
    with n the larger number.
    """
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from flat_arrays(_joined(name, key), entry)
        return
    array = np.asarray(value)
    if array.dtype.kind not in NUMBERS:
        return
    array = np.atleast_1d(array.squeeze())
    if array.ndim == 1:
        yield name, array
    elif array.ndim == 2:
        wide = array if array.shape[0] > array.shape[1] else array.T
        for k in range(wide.shape[1] if wide.shape[1] <= WIDEST else 0):
            yield f"{name}[{k}]", wide[:, k]


def flat_numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield every single number of a message, with its name.

    Where a mapping has a list ``name`` as long as another list, as ``sensor_msgs/JointState`` has,
    the items of the other go by these names: ``position[elbow]``. A time of ROS 2, with ``sec`` and
    ``nanosec``, is one number in nanoseconds.
    """
    if isinstance(value, Mapping) and value.keys() == {"sec", "nanosec"}:
        yield name, float(value["sec"] * 1_000_000_000 + value["nanosec"])
    elif isinstance(value, Mapping):
        names = value.get("name")
        for key, entry in value.items():
            path = _joined(name, key)
            if isinstance(entry, list | tuple) and isinstance(names, list | tuple):
                if len(entry) == len(names) and key != "name":
                    for label, item in zip(names, entry, strict=True):
                        yield from flat_numbers(f"{path}[{label}]", item)
            else:
                yield from flat_numbers(path, entry)
    elif isinstance(value, list | tuple):
        for k, item in enumerate(value):
            yield from flat_numbers(f"{name}[{k}]", item)
    elif isinstance(value, bool | int | float):
        yield name, float(value)


def _joined(name: str, key: object) -> str:
    path = f"{name}.{key}" if name else str(key)
    if len(path) > LONGEST:
        raise ValueError(f"a name has more than {LONGEST} characters")
    return path


def sliced(columns: Mapping[str, NDArray[Any]], rows: int) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield a table that is in memory in pieces of so many rows.

    Columns that are shorter than others, with a clock of their own, cannot be cut at the same
    rows: then the table comes in one piece.
    """
    lengths = {len(values) for values in columns.values()}
    if len(lengths) != 1:
        yield dict(columns)
        return
    for start in range(0, max(lengths.pop(), 1), rows):
        yield {name: values[start : start + rows] for name, values in columns.items()}
