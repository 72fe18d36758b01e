"""A dry run against the emulated nominal joint that prints the frames sent."""

from __future__ import annotations

import sys
from typing import final

import can

SHOWN = 40
"""Frames that are shown one by one."""


@final
class Frames:
    """Prints the first frames sent, and counts all."""

    def __init__(self) -> None:
        self.count = 0
        self.by_id: dict[int, int] = {}

    def __call__(self, t: float, message: can.Message) -> None:
        """Take a frame that is sent at a time [s]."""
        self.count += 1
        identifier = message.arbitration_id
        self.by_id[identifier] = self.by_id.get(identifier, 0) + 1
        if self.count <= SHOWN:
            width = 8 if message.is_extended_id else 3
            kind = "remote" if message.is_remote_frame else message.data.hex(" ")
            sys.stderr.write(f"{t * 1e3:10.3f} ms  {identifier:0{width}X}  {kind}\n")
        elif self.count == SHOWN + 1:
            sys.stderr.write("...\n")
