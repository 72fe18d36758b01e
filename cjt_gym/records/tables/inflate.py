"""Compressed data that are unpacked as far as a file may hold."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Final

from cjt_gym.disk import NUMBERS
from cjt_gym.errors import RecordError

PIECE: Final = 1 << 20  # bytes that are inflated before their number is checked


def inflated(data: bytes, path: Path, before: int = 0) -> bytes:
    """Return what a zlib stream holds, as far as it is sound."""
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
