"""Layouts of frame data, written once for codec, documentation and tests.

The fields of a :class:`Layout` follow each other without gaps. In a little-endian layout the first
one takes the least significant bits of the data read as one little-endian number; in a big-endian
layout the most significant bits of the data read as one big-endian number.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil, isfinite
from typing import Final, Literal

from cjt_gym.errors import ProtocolError

FLOATS: Final = {16: "<e", 32: "<f", 64: "<d"}


@dataclass(frozen=True)
class Field:
    """A value in the data of a frame: ``value = raw * scale + offset``."""

    name: str  # its name in the manufacturer's document
    bits: int  # its number of bits
    # its type: "uint", "int" (two's complement) or "float" (IEEE 754)
    kind: Literal["uint", "int", "float"] = "uint"
    scale: float = 1.0  # value of one step of the raw number
    offset: float = 0.0  # value of the raw number zero
    unit: str = ""  # its unit; empty for a plain number
    text: str = ""  # short description
    names: Mapping[int, str] = field(default_factory=dict)  # names of raw numbers, or of their bits

    @property
    def plain(self) -> bool:
        """Whether the value is the raw number itself."""
        return self.scale == 1.0 and self.offset == 0.0

    @property
    def raw_range(self) -> tuple[int, int]:
        """Smallest and largest raw number of an integer field."""
        if self.kind == "int":
            return -(1 << self.bits - 1), (1 << self.bits - 1) - 1
        return 0, (1 << self.bits) - 1

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value [unit]; unbounded for a float."""
        if self.kind == "float":
            return float("-inf"), float("inf")
        low, high = (raw * self.scale + self.offset for raw in self.raw_range)
        return min(low, high), max(low, high)

    def to_bits(self, value: float) -> int:
        """Return the bits of a value as a non-negative number.

        Values are rounded to the nearest step, halves down.
        """
        if not isfinite(value):
            raise ProtocolError(f"{self.name} must be a finite number, got {value}.")
        raw = value if self.plain else (value - self.offset) / self.scale
        if self.kind == "float":
            return _float_bits(self, raw)
        number = ceil(raw - 0.5)
        low, high = self.raw_range
        if not low <= number <= high:
            least, most = self.range
            unit = f" {self.unit}" if self.unit else ""
            raise ProtocolError(
                f"{self.name} must lie in [{least:.6g}, {most:.6g}]{unit}, got {value:.6g}{unit}."
            )
        return number & (1 << self.bits) - 1

    def from_bits(self, bits: int) -> float:
        """Return the value of bits; NaN and infinities are passed through."""
        if self.kind == "float":
            number: float = struct.unpack(
                FLOATS[self.bits], bits.to_bytes(self.bits // 8, "little")
            )[0]
        elif self.kind == "int" and bits >> self.bits - 1:
            number = bits - (1 << self.bits)
        else:
            number = bits
        return number if self.plain else number * self.scale + self.offset


def _float_bits(given: Field, raw: float) -> int:
    try:
        return int.from_bytes(struct.pack(FLOATS[given.bits], raw), "little")
    except OverflowError:
        raise ProtocolError(
            f"{given.name} must fit a float of {given.bits} bits, got {raw:.6g}."
        ) from None


def nothing(bits: int) -> Field:
    """Return a field of reserved bits, which are written as zero and ignored."""
    return Field("", bits)


@dataclass(frozen=True)
class Layout:
    """The data of a frame.

    Example:
        >>> layout = Layout((Field("speed", 12, scale=0.5), nothing(4)), "big")
        >>> layout.encode({"speed": 10.0}).hex(), layout.decode(bytes.fromhex("0140"))
        ('0140', {'speed': 10.0})
    """

    fields: tuple[Field, ...]  # its fields, in the order given in the module's docstring
    order: Literal["little", "big"] = "little"  # byte order

    @cached_property
    def size(self) -> int:
        """Number of bytes."""
        return sum(each.bits for each in self.fields) // 8

    @cached_property
    def least(self) -> int:
        """Number of bytes up to the last one that is not reserved."""
        ends, bits = [0], 0
        for each in self.fields:
            bits += each.bits
            if each.name:
                ends.append(bits)
        return -(-ends[-1] // 8)

    @cached_property
    def _places(self) -> tuple[tuple[Field, int], ...]:
        """Fields that are not reserved, with the position of their lowest bit."""
        places, bits = [], 0
        for each in self.fields:
            at = bits if self.order == "little" else self.size * 8 - bits - each.bits
            bits += each.bits
            if each.name:
                places.append((each, at))
        return tuple(places)

    def encode(self, values: Mapping[str, float]) -> bytes:
        """Encode values; fields not given are zero."""
        number = 0
        for each, at in self._places:
            number |= each.to_bits(values.get(each.name, 0.0)) << at
        return number.to_bytes(self.size, self.order)

    def decode(self, data: bytes | bytearray) -> dict[str, float]:
        """Decode data; bytes after the last field are ignored."""
        size, least = self.size, self.least
        if len(data) < least:
            raise ProtocolError(f"The frame must have {least} bytes of data, got {len(data)}.")
        number = int.from_bytes(data[:size].ljust(size, b"\0"), self.order)
        return {
            each.name: each.from_bits(number >> at & (1 << each.bits) - 1)
            for each, at in self._places
        }
