"""moteus: table of registers, and the subframes that read and write them.

A CAN FD frame is a sequence of subframes. Each one writes, queries or returns consecutive registers
of one type: an integer of 8, 16 or 32 bits, or a float. The step of an integer depends on the
quantity; the lowest integer stands for NaN. Unused bytes at the end are 0x50.

References:
    mjbots Robotic Systems, moteus: docs/protocol/can.md and docs/protocol/registers.md.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, isnan, nan
from typing import Final, Literal, NamedTuple

from can.util import dlc2len, len2dlc

from cjt_gym.canbus.protocols.layout import Field
from cjt_gym.errors import ProtocolError

INT8, INT16, INT32, FLOAT = range(4)
"""Types of registers, as the subframes number them."""
SIZES: Final = (1, 2, 4, 4)
LARGEST: Final = 3.4e38
"""Largest number that a float has room for."""
CODES: Final = "bhif"
STEPS: Final = {
    "number": ("", (1.0, 1.0, 1.0)),
    "share": ("", (1 / 127, 1 / 32767, 1 / 2147483647)),
    "current": ("A", (1.0, 0.1, 0.001)),
    "torque": ("N m", (0.5, 0.01, 0.001)),
    "voltage": ("V", (0.5, 0.1, 0.001)),
    "temperature": ("degC", (1.0, 0.1, 0.001)),
    "time": ("s", (0.01, 0.001, 0.000001)),
    "position": ("rev", (0.01, 0.0001, 0.00001)),
    "velocity": ("rev/s", (0.1, 0.00025, 0.00001)),
    "power": ("W", (10.0, 0.05, 0.0001)),
}
"""Unit of each quantity, and what one step of an integer of 8, 16 and 32 bits means."""
MODES: Final = {
    0: "stopped",
    1: "fault",
    2: "preparing",
    3: "preparing",
    4: "preparing",
    10: "position",
    11: "timeout",
    12: "zero velocity",
    15: "brake",
}
FAULTS: Final = {
    32: "calibration",
    33: "motor driver",
    34: "supply voltage too high",
    35: "encoder",
    36: "motor not configured",
    37: "pwm cycle overrun",
    38: "too hot",
    39: "outside of the position limits",
    40: "supply voltage too low",
    41: "configuration changed",
    42: "no commutation encoder",
    43: "no output encoder",
    44: "driver could not be enabled",
    46: "timing violation",
    49: "position control error",
    50: "velocity control error",
}


@dataclass(frozen=True)
class MoteusRegister:
    """A register, of one of the quantities of :data:`STEPS`."""

    number: int
    name: str
    quantity: str
    writable: bool = False
    text: str = ""
    names: Mapping[int, str] | None = None

    def field(self, kind: int) -> Field:
        """Return the field of one type."""
        unit, steps = STEPS[self.quantity]
        names = self.names or {}
        if kind == FLOAT:
            return Field(self.name, 32, "float", unit=unit, text=self.text, names=names)
        return Field(self.name, 8 * SIZES[kind], "int", steps[kind], 0.0, unit, self.text, names)


REGISTERS: Final = {
    row.number: row
    for row in (
        MoteusRegister(0x000, "Mode", "number", True, "first in a command", MODES),
        MoteusRegister(0x001, "Position", "position", text="of the output"),
        MoteusRegister(0x002, "Velocity", "velocity", text="of the output"),
        MoteusRegister(0x003, "Torque", "torque", text="of the output"),
        MoteusRegister(0x004, "Q phase current", "current"),
        MoteusRegister(0x005, "D phase current", "current"),
        MoteusRegister(0x006, "Absolute position", "position"),
        MoteusRegister(0x007, "Electrical power", "power"),
        MoteusRegister(0x00A, "Motor temperature", "temperature", text="where it has a sensor"),
        MoteusRegister(0x00B, "Trajectory complete", "number"),
        MoteusRegister(0x00C, "Home state", "number"),
        MoteusRegister(0x00D, "Voltage", "voltage", text="of the supply"),
        MoteusRegister(0x00E, "Temperature", "temperature", text="of the board"),
        MoteusRegister(0x00F, "Fault code", "number", names=FAULTS),
        MoteusRegister(0x020, "Position command", "position", True, "NaN: where it is"),
        MoteusRegister(0x021, "Velocity command", "velocity", True),
        MoteusRegister(0x022, "Feedforward torque", "torque", True),
        MoteusRegister(0x023, "Kp scale", "share", True, "1 where not written"),
        MoteusRegister(0x024, "Kd scale", "share", True, "1 where not written"),
        MoteusRegister(0x025, "Maximum torque", "torque", True, "NaN: as configured"),
        MoteusRegister(0x027, "Watchdog timeout", "time", True, "0: as configured"),
        MoteusRegister(0x02B, "Ki ilimit scale", "share", True, "1 where not written"),
    )
}
"""The registers that are used here, by their numbers."""
WRITE, ASK, REPLY = 0x00, 0x10, 0x20
WRITE_ERROR, READ_ERROR, NOTHING = 0x30, 0x31, 0x50
MOST: Final = 64
"""Bytes that a CAN FD frame has room for."""


class Subframe(NamedTuple):
    """Content of a subframe: consecutive registers of a type, and their values but in a query."""

    kind: Literal["write", "ask", "reply", "error"]
    numbers: range
    type: int
    values: Sequence[float] = ()


def subframe(base: int, kind: int, first: int, values: Sequence[float] | int) -> bytes:
    """Return a subframe with values, or for ASK with the number of registers."""
    count = values if isinstance(values, int) else len(values)
    head = bytes([base | kind << 2 | count]) if count < 4 else bytes([base | kind << 2, count])
    data = (
        b""
        if isinstance(values, int)
        else b"".join(packed(first + at, kind, value) for at, value in enumerate(values))
    )
    return head + _varuint(first) + data


def packed(number: int, kind: int, value: float) -> bytes:
    """Return the bytes of a register."""
    size = SIZES[kind]
    if kind == FLOAT and not abs(value) > LARGEST:
        return struct.pack("<f", value)
    if isnan(value):
        return (1 << 8 * size - 1).to_bytes(size, "little")
    return field_of(number, kind).to_bits(value).to_bytes(size, "little")


def read(data: bytes | bytearray) -> list[Subframe]:
    """Decode a frame; unknown registers give plain numbers."""
    found: list[Subframe] = []
    at = 0
    while at < len(data):
        base = data[at]
        at += 1
        if base == NOTHING:
            continue
        if base in (WRITE_ERROR, READ_ERROR):
            number, at = _read_varuint(data, at)
            code, at = _read_varuint(data, at)
            found.append(Subframe("error", range(number, number + 1), INT8, (code,)))
        elif base < WRITE_ERROR:
            group, kind, count = base & 0x30, base >> 2 & 3, base & 3
            if not count:
                count, at = _read_varuint(data, at)
            first, at = _read_varuint(data, at)
            if group == ASK:
                numbers = range(first, first + min(count, MOST))
                found.append(Subframe("ask", numbers, kind))
                continue
            if at + count * SIZES[kind] > len(data):
                raise ProtocolError("A subframe must end within the frame; this one does not.")
            numbers, values = range(first, first + count), _unpacked(first, kind, count, data, at)
            found.append(Subframe("write" if group == WRITE else "reply", numbers, kind, values))
            at += count * SIZES[kind]
        else:
            raise ProtocolError(f"There is no subframe {base:#04x}.")
    return found


class Replies:
    """Replies to one query, in which every register has its place."""

    def __init__(self, asked: Iterable[Subframe]) -> None:
        """Lay a reply out."""
        self._heads: list[tuple[int, bytes]] = []
        self._places: list[tuple[int, int, float, int, float]] = []
        self._blank: list[bytes | float] = []
        code = "<"
        for each in asked:
            head = subframe(REPLY, each.type, each.numbers[0], len(each.numbers))
            code += f"{len(head)}s{len(each.numbers)}{CODES[each.type]}"
            self._heads.append((len(self._blank), head))
            self._blank += [head, *each.numbers]
            lowest = nan if each.type == FLOAT else -(1 << 8 * SIZES[each.type] - 1)
            for at, number in enumerate(each.numbers, self._heads[-1][0] + 1):
                step = 1.0 if each.type == FLOAT else _step(number, each.type)
                self._places.append((at, number, step, each.type, lowest))
        self._layout = struct.Struct(code)
        self._tail = pad(bytes(self._layout.size))[self._layout.size :]

    def values(self, data: bytes | bytearray) -> dict[int, float]:
        """Return the values of a reply by register number; none if it is laid out otherwise."""
        if data[self._layout.size :] != self._tail or len(data) < self._layout.size:
            return {}
        raw = self._layout.unpack_from(data)
        for at, head in self._heads:
            if raw[at] != head:
                return {}
        return {
            number: nan if raw[at] == lowest else raw[at] * step
            for at, number, step, _, lowest in self._places
        }

    def data(self, shown: Callable[[int, int], float]) -> bytes:
        """Return a reply, padded; `shown` gives a register's value in a type, NaN for none."""
        raw = list(self._blank)
        for at, number, step, kind, lowest in self._places:
            value = shown(number, kind)
            if kind != FLOAT:
                value = lowest if isnan(value) else ceil(value / step - 0.5)
            raw[at] = value
        return self._layout.pack(*raw) + self._tail


def said(frame: Sequence[Subframe], kind: str) -> dict[int, float]:
    """Return the values that a frame writes or returns, by register number."""
    return {
        number: value
        for each in frame
        if each.kind == kind
        for number, value in zip(each.numbers, each.values, strict=True)
    }


def pad(data: bytes) -> bytes:
    """Pad data to a length that CAN FD allows."""
    if len(data) > MOST:
        raise ProtocolError(f"A frame must have at most {MOST} bytes of data, got {len(data)}.")
    return data.ljust(dlc2len(len2dlc(len(data))), bytes([NOTHING]))


@cache
def field_of(number: int, kind: int) -> Field:
    """Return the field of a register in one type."""
    return REGISTERS[number].field(kind)


def _unpacked(
    first: int, kind: int, count: int, data: bytes | bytearray, at: int
) -> Sequence[float]:
    raw: Sequence[float] = struct.unpack_from(f"<{count}{CODES[kind]}", data, at)
    if kind == FLOAT:
        return raw
    lowest = -(1 << 8 * SIZES[kind] - 1)
    return [
        nan if number == lowest else number * _step(first + k, kind) for k, number in enumerate(raw)
    ]


def _step(number: int, kind: int) -> float:
    register = REGISTERS.get(number)
    return STEPS[register.quantity][1][kind] if register else 1.0


def _varuint(number: int) -> bytes:
    head = b""
    while number > 0x7F:
        head += bytes([number & 0x7F | 0x80])
        number >>= 7
    return head + bytes([number])


def _read_varuint(data: bytes | bytearray, at: int) -> tuple[int, int]:
    number = 0
    for place in range(5):
        if at + place >= len(data):
            break
        number |= (data[at + place] & 0x7F) << 7 * place
        if data[at + place] < 0x80:
            return number, at + place + 1
    raise ProtocolError("A number in a subframe must end within it and within 5 bytes.")
