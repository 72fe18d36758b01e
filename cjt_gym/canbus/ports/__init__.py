"""Ends of a CAN bus for the emulator: python-can, socketcand, slcan on a pseudo-terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, final

import can

from cjt_gym.canbus.link import open_bus
from cjt_gym.canbus.ports.socketcand import SocketcandPort
from cjt_gym.canbus.settings import BusSettings
from cjt_gym.errors import ConfigurationError

__all__ = ["BusPort", "Port", "SocketcandPort", "open_port"]

PTY = "pty"
"""Channel with which an emulated slcan adapter takes any free pseudo-terminal."""


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


def open_port(settings: BusSettings) -> Port:
    """Return the emulator's end of a bus.

    ``socketcand`` gives a server, ``slcan`` an adapter on a pseudo-terminal, with a link to it if
    the channel is a path, and anything else python-can's own bus.
    """
    if settings.interface == "socketcand":
        return SocketcandPort(settings.host, settings.port, settings.channel)
    if settings.interface == "slcan":
        return _adapter(None if settings.channel == PTY else settings.channel)
    return BusPort(open_bus(settings))


def _adapter(link: str | None) -> Port:
    """Return an slcan adapter; Windows has neither pseudo-terminals nor their modules."""
    try:
        from cjt_gym.canbus.ports.slcan import SlcanPort
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            "An emulated slcan adapter needs pseudo-terminals, which this system does not have. "
            'Set interface = "socketcand" or "virtual" under [bus].'
        ) from error
    return SlcanPort(link)
