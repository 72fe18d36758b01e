"""The emulator's end of a bus: its interface, and any python-can bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, final

import can


class Port(Protocol):
    """An end of a bus that sends and receives frames."""

    @property
    def address(self) -> str:
        """Address for clients, in words."""

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return what has arrived, waiting up to `timeout` [s] for it."""

    def send(self, message: can.Message) -> None:
        """Send a frame to all clients."""

    def close(self) -> None:
        """Release the port."""


@final
class BusPort:
    """A port on a python-can bus, which it shuts down."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus

    @property
    def address(self) -> str:
        """The bus, as python-can names it."""
        return str(self.bus.channel_info)

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return what has arrived, waiting up to `timeout` [s] for it."""
        found = []
        message = self.bus.recv(timeout)
        while message is not None:
            found.append(message)
            message = self.bus.recv(0.0)
        return found

    def send(self, message: can.Message) -> None:
        """Send a frame; without a receiver it is lost."""
        self.bus.send(message)

    def close(self) -> None:
        """Shut the bus down."""
        self.bus.shutdown()
