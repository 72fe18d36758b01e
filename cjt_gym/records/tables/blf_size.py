"""What a BLF file makes of itself, before python-can reads it, which follows any size it finds."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from cjt_gym.errors import RecordError
from cjt_gym.records.tables.inflate import inflated

HEADER: Final = struct.Struct("<4sL")
OBJECT: Final = struct.Struct("<4s4xLL")
CONTAINER, PLAIN, DEFLATED = 10, b"\0\0", b"\x02\0"
LARGEST: Final = 1 << 20
"""Bytes of an object in a container; that of a frame has about a hundred."""


def check_size(path: Path) -> None:
    """Raise RecordError where a file is none, makes more of itself than it may, or has no end."""
    total, tail = 0, b""
    for content in _containers(path):
        data = content[OBJECT.size :]
        if content[:2] == DEFLATED:
            data = inflated(data, path, total)
        elif content[:2] != PLAIN:
            continue
        total += len(data)
        tail = _rest(path, tail + data)


def _containers(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        mark, size = HEADER.unpack(file.read(HEADER.size).ljust(HEADER.size, b"\0"))
        if mark != b"LOGG":
            raise RecordError(f"{path} must be a trace of a CAN bus; it does not begin as BLF.")
        file.seek(size)
        while len(head := file.read(OBJECT.size)) == OBJECT.size:
            mark, size, kind = OBJECT.unpack(head)
            if mark != b"LOBJ" or size < OBJECT.size:
                raise RecordError(f"{path} must be a trace of a CAN bus; an object has no end.")
            content = file.read(size - OBJECT.size)
            file.seek(size % 4, 1)
            if kind == CONTAINER:
                yield content


def _rest(path: Path, data: bytes) -> bytes:
    """Return what follows the last whole object of a container, with which the next one begins."""
    at = 0
    while (found := data.find(b"LOBJ", at, at + 8)) >= 0 and found + OBJECT.size <= len(data):
        _, size, _ = OBJECT.unpack_from(data, found)
        if not OBJECT.size <= size <= LARGEST:
            raise RecordError(
                f"{path} must be a trace of a CAN bus; an object in it has {size} bytes."
            )
        if found + size > len(data):
            break
        at = found + size
    return data[at:] if len(data) - at <= LARGEST else b""
