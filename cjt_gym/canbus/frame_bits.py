"""Time of a frame on the wire, stuff bits included.

References:
    ISO 11898-1:2015, 10.4 (frames), 10.5 (bit stuffing), 10.4.2.6 (CRC).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import can
from can.util import dlc2len, len2dlc

POLYNOMIAL: Final = 0x4599
"""Of the CRC of classical frames, 15 bits."""
TAIL: Final = 13
"""CRC delimiter, acknowledgement and its delimiter, end of frame, and the space to the next one."""
RUN: Final = 5
"""Equal bits after which one is stuffed in."""


class FrameBits(NamedTuple):
    """Bits of a frame: at the nominal bit rate, and at that of the data phase."""

    nominal: int
    fast: int


def wire_time(message: can.Message, bitrate: float, data_bitrate: float) -> float:
    """Return how long a frame occupies the bus [s], with the interframe space; rates in bit/s."""
    bits = bits_of(message)
    return bits.nominal / bitrate + bits.fast / data_bitrate


def bits_of(message: can.Message) -> FrameBits:
    """Return the bits of a frame."""
    code = len2dlc(message.dlc)
    size = 0 if message.is_remote_frame else dlc2len(code)
    data = _bits(int.from_bytes(bytes(message.data).ljust(size, b"\0"), "big"), 8 * size)
    rest = [*_bits(code, 4), *data]
    if not message.is_fd:
        head = _head(message, [0, 0] if message.is_extended_id else [0])
        whole = [*head, *rest]
        whole += _bits(crc(whole), 15)
        return FrameBits(len(whole) + stuffed(whole) + TAIL, 0)
    head = _head(message, [1, 0, int(message.bitrate_switch)])
    rest = [int(message.error_state_indicator), *rest]
    # stuff count and CRC have a fixed stuff bit before every four bits, and the first one
    check = 4 + (17 if size <= 16 else 21)
    check += -(-check // 4)
    before, both = stuffed(head), stuffed([*head, *rest])
    slow, fast = len(head) + before + TAIL - 1, len(rest) + both - before + check + 1
    return FrameBits(slow, fast) if message.bitrate_switch else FrameBits(slow + fast, 0)


def _head(message: can.Message, control: Sequence[int]) -> list[int]:
    """Return the bits up to the length code, or up to the switch of the bit rate in FD frames."""
    remote = int(message.is_remote_frame)
    identifier = message.arbitration_id
    if message.is_extended_id:
        high, low = _bits(identifier >> 18, 11), _bits(identifier & 0x3FFFF, 18)
        return [0, *high, 1, 1, *low, remote, *control]
    return [0, *_bits(identifier, 11), remote, 0, *control]


def crc(bits: Sequence[int]) -> int:
    """Return the CRC of a classical frame's bits."""
    register = 0
    for bit in bits:
        top = register >> 14 & 1
        register = register << 1 & 0x7FFF
        if top != bit:
            register ^= POLYNOMIAL
    return register


def stuffed(bits: Sequence[int]) -> int:
    """Return the number of stuff bits."""
    count, run, last = 0, 0, -1
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        if run == RUN:  # the bit that follows is the opposite, and counts for the next run
            count, run, last = count + 1, 1, 1 - bit
    return count


def _bits(value: int, width: int) -> list[int]:
    return [value >> at & 1 for at in range(width - 1, -1, -1)]
