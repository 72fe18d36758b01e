"""What an emulator asks of its end of the bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import can


class Port(Protocol):
    """An end of a bus that takes and gives frames."""

    @property
    def address(self) -> str:
        """Where a client finds it, in words."""
        ...

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return what has arrived, waiting up to `timeout` [s] where nothing has."""
        ...

    def send(self, message: can.Message) -> None:
        """Send a frame to whoever listens."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...
