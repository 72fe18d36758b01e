"""Interface of the emulator's end of a bus."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import can


class Port(Protocol):
    """An end of a bus that sends and receives frames."""

    @property
    def address(self) -> str:
        """Address for clients, in words."""
        ...

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return what has arrived, waiting up to `timeout` [s] for it."""
        ...

    def send(self, message: can.Message) -> None:
        """Send a frame to all clients."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...
