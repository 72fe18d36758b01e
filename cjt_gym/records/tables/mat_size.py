"""What a MATLAB file of version 5 to 7.2 makes of itself, before SciPy reads it.

SciPy's reader recurses in compiled code, so that deep nesting ends the process, and makes as many
cells and fields as a few bytes say there are.
"""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path
from typing import Final

from cjt_gym.disk import NUMBERS
from cjt_gym.errors import RecordError

HEADER: Final = 128
INT32, MATRIX, COMPRESSED = 5, 14, 15
CELL, STRUCT, OBJECT, SPARSE = 1, 2, 3, 5
LAST_CLASS: Final = 15
"""Classes of arrays up to this one give their dimensions second."""
DEEPEST: Final = 32
PIECE: Final = 1 << 20


def check_size(path: Path) -> None:
    """Raise RecordError where a file is nested too deeply, or holds more than it may.

    What is not understood is left to the reader.
    """
    data = path.read_bytes()
    mark = data[HEADER - 2 : HEADER]
    if len(data) <= HEADER or mark not in (b"IM", b"MI") or not any(data[:4]):
        return
    order, at, total = "<" if mark == b"IM" else ">", HEADER, 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        body = data[at + 8 : at + 8 + size]
        if kind == COMPRESSED:
            body = inflated(body, path, total)
            total += len(body)
            _check_elements(body, order, path)
        elif kind == MATRIX:
            _check_elements(data[at : at + 8 + size], order, path)
        at += 8 + size


def inflated(data: bytes, path: Path, before: int = 0) -> bytes:
    """Return what a zlib stream holds, as far as it is sound.

    Args:
        data: The stream.
        path: File that it is from.
        before: Bytes that others of that file have made.

    Raises:
        RecordError: Together they are more than a file may hold.
    """
    unpack, pieces = zlib.decompressobj(), []
    while data:
        try:
            pieces.append(unpack.decompress(data, PIECE))
        except zlib.error:
            break
        before += len(pieces[-1])
        NUMBERS.check(before // 8, path, RecordError)
        data = unpack.unconsumed_tail
    return b"".join(pieces)


def _check_elements(data: bytes, order: str, path: Path) -> None:
    """Check arrays and the arrays within them, without a call per level."""
    todo = [(0, len(data), 0)]
    while todo:
        at, end, depth = todo.pop()
        if depth > DEEPEST:
            raise RecordError(
                f"{path} must be nested at most {DEEPEST} levels deep. Save its vectors as "
                "variables of their own."
            )
        while at + 8 <= end:
            kind, size = struct.unpack_from(f"{order}II", data, at)
            if kind >> 16:  # a small element, whose data are in its tag
                at += 8
                continue
            if kind == MATRIX and size:
                stop = min(at + 8 + size, end)
                _check_dimensions(data[at + 8 : min(stop, at + 8 + PIECE)], stop - at, order, path)
                todo.append((at + 8, stop, depth + 1))
            at += 8 + size + (-size % 8 if kind != MATRIX else 0)


def _check_dimensions(head: bytes, size: int, order: str, path: Path) -> None:
    """Check that an array has as many items as its bytes can hold; the array's flags come first."""
    if len(head) < 32:
        return
    (flags,) = struct.unpack_from(f"{order}I", head, 8)
    kind, length = struct.unpack_from(f"{order}II", head, 16)
    if flags & 0xFF > LAST_CLASS or flags & 0xFF == SPARSE or kind != INT32 or length % 4:
        return
    count = min(length, len(head) - 24) // 4
    items = math.prod(max(n, 0) for n in struct.unpack_from(f"{order}{count}i", head, 24))
    each = 8 if flags & 0xFF in (CELL, STRUCT, OBJECT) else 1
    if items * each > size:
        raise RecordError(f"{path} has an array of {items} items in {size} bytes.")
