"""MATLAB files of version 5 to 7.2: numeric arrays, and those within structures.

SciPy's reader of this version is compiled code that trusts the file: damaged ones end the process,
nested ones exhaust the stack. This one reads what a record can be made of, and skips the rest.

References:
    The MathWorks, "MAT-File Format", chapter "Level 5 MAT-File Format".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.records.tables.inflate import inflated

HEADER: Final = 128
INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15
STORED: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}
"""Types of the numbers in a file."""
CLASSES: Final = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"} | {
    14: "i8",
    15: "u8",
}
"""Types of the arrays that they stand for."""
STRUCT, OBJECT, OPAQUE = 2, 3, 17
COMPLEX: Final = 0x800
DEEPEST: Final = 32  # levels of nesting; files that were made to exhaust the stack have more
Element = tuple[int, bytes]
"""Type and content."""


def is_mat5(head: bytes) -> bool:
    """Whether a file that begins so is of these versions; version 4 begins with a number."""
    return len(head) >= HEADER and 0 not in head[:4] and head[126:HEADER] in (b"IM", b"MI")


def read_mat5(path: Path) -> dict[str, Any]:
    """Return the variables of a file by name: arrays, dictionaries of them, None for the rest."""
    data, total = path.read_bytes(), 0
    order = "<" if data[126:HEADER] == b"IM" else ">"
    found = {}
    for kind, content in _elements(data[HEADER:], order):
        if kind == COMPRESSED:
            content = inflated(content, path, total)
            total += len(content)
            kind, content = next(_elements(content, order), (0, b""))
        if kind != MATRIX:
            raise ValueError(f"a variable has the type {kind}")
        name, value = _array(content, order, 0)
        if name:  # what has none belongs to functions
            found[name] = value
    return found


def _elements(data: bytes, order: str) -> Iterator[Element]:
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if kind >> 16:  # a small one, whose content is in its tag
            kind, size, begin, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        else:
            begin = at + 8
            after = begin + size + (-size % 8 if kind != COMPRESSED else 0)
        if begin + size > len(data) or (after == at + 8 and size > 4 and begin == at + 4):
            raise ValueError("it ends too early")
        yield kind, data[begin : begin + size]
        at = after


def _array(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    if depth > DEEPEST:
        raise ValueError(f"it is nested more than {DEEPEST} levels deep")
    if not data:
        return "", None
    parts = _elements(data, order)
    flags, _ = np.frombuffer(_next(parts, UINT32), f"{order}u4", 2).tolist()
    kind = flags & 0xFF
    if kind == OPAQUE:  # a figure, table or other object, which has no shape
        return _next(parts, INT8).decode("latin-1"), None
    shape = tuple(np.frombuffer(_next(parts, INT32, UINT32), f"{order}i4").tolist())
    name = _next(parts, INT8).decode("latin-1")
    if kind in (STRUCT, OBJECT) and math.prod(shape) == 1:
        return name, _fields(parts, order, kind, depth)
    if kind in CLASSES and not flags & COMPLEX:
        return name, _numbers(next(parts), shape, order).astype(CLASSES[kind])
    return name, None


def _next(parts: Iterator[Element], *wanted: int) -> bytes:
    kind, content = next(parts, (0, b""))
    if kind not in wanted:
        raise ValueError(f"an array has a part of type {kind} in place of {wanted[0]}")
    return content


def _numbers(part: Element, shape: tuple[int, ...], order: str) -> NDArray[Any]:
    kind, content = part
    if kind not in STORED:
        raise ValueError(f"an array has numbers of type {kind}")
    values = np.frombuffer(content, f"{order}{STORED[kind]}")
    if min(shape, default=0) < 0 or math.prod(shape) != len(values):
        raise ValueError(f"an array of shape {shape} has {len(values)} numbers")
    return values.reshape(shape, order="F")


def _fields(parts: Iterator[Element], order: str, kind: int, depth: int) -> dict[str, Any]:
    """Return the fields of a structure or of an object, which is a structure with a class."""
    if kind == OBJECT:
        _next(parts, INT8)
    (width,) = np.frombuffer(_next(parts, INT32), f"{order}i4", 1).tolist()
    text = _next(parts, INT8)
    if width < 1:
        raise ValueError(f"names of fields have {width} characters")
    names = [text[k : k + width].split(b"\0")[0] for k in range(0, len(text), width)]
    return {
        name.decode("latin-1"): _array(_next(parts, MATRIX), order, depth + 1)[1] for name in names
    }
