"""A link to an emulator in the same process, in the emulator's own time."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Sequence
from typing import final

import can

from cjt_gym.canbus.emulated_arm import EmulatedArm
from cjt_gym.canbus.emulator import Emulator
from cjt_gym.canbus.link import Arrival, Supervisor
from cjt_gym.canbus.stamps import RECEPTION
from cjt_gym.errors import HardwareError

SHOWN = 40
"""Frames that are shown one by one in a dry run."""


@final
class VirtualLink:
    """A link with the emulator's clock, which runs as fast as the machine allows.

    Attributes:
        emulator: The emulator.
        is_off: Whether the bus is lost; set it to simulate that.
        sent: Called with every frame sent and its time, or None.
        stamps: Clock of the arrival times.
    """

    stamps = RECEPTION

    def __init__(self, emulator: Emulator | EmulatedArm) -> None:
        self.emulator = emulator
        self.is_off = False
        self.sent: Callable[[float, can.Message], None] | None = None
        self._supervise: Supervisor | None = None
        self._every = 1e-3
        self._inbox: list[Arrival] = []

    def now(self) -> float:
        """Return the emulator's time [s]."""
        return self.emulator.now

    def wait_until(self, t: float) -> None:
        """Advance the emulator's time."""
        while self.emulator.now < t:
            self.emulator.advance(min(t, self.emulator.now + self._every))
            self._inbox += [Arrival(due.t, due.message) for due in self.emulator.receive()]
            if self._supervise is not None:
                self._supervise(self.emulator.now)

    def send(self, messages: Sequence[can.Message]) -> None:
        """Send frames."""
        if self.is_off:
            raise HardwareError("The bus does not take a frame: it is off.")
        for message in messages:
            if self.sent is not None:
                self.sent(self.emulator.now, message)
        self.emulator.send(messages)

    def receive(self) -> list[Arrival]:
        """Return all frames since the last call."""
        if self.is_off:
            raise HardwareError("The bus is lost: it is off.")
        self._inbox += [Arrival(due.t, due.message) for due in self.emulator.receive()]
        found, self._inbox = self._inbox, []
        return found

    def watch(self, supervise: Supervisor, every: float) -> None:
        """Call `supervise(now)` at least once in `every` seconds of the emulator's time."""
        self._supervise, self._every = supervise, every

    def close(self) -> None:
        """Forget the supervisors; the emulator remains usable."""
        self._supervise = None


@final
class Frames:
    """Prints the first frames sent in a dry run, and counts all."""

    def __init__(self) -> None:
        self.by_id: Counter[int] = Counter()

    def __call__(self, t: float, message: can.Message) -> None:
        """Take a frame that is sent at a time [s]."""
        identifier = message.arbitration_id
        self.by_id[identifier] += 1
        if (count := self.by_id.total()) <= SHOWN:
            width = 8 if message.is_extended_id else 3
            kind = "remote" if message.is_remote_frame else message.data.hex(" ")
            sys.stderr.write(f"{t * 1e3:10.3f} ms  {identifier:0{width}X}  {kind}\n")
        elif count == SHOWN + 1:
            sys.stderr.write("...\n")
