"""Ends of a CAN bus for the emulator: python-can, socketcand, slcan on a pseudo-terminal."""

from __future__ import annotations

from cjt_gym.canbus.link import open_bus
from cjt_gym.canbus.ports.bus import BusPort, Port
from cjt_gym.canbus.ports.socketcand import SocketcandPort
from cjt_gym.canbus.settings import BusSettings
from cjt_gym.errors import ConfigurationError

__all__ = ["BusPort", "Port", "SocketcandPort", "open_port"]

PTY = "pty"
"""Channel with which an emulated slcan adapter takes any free pseudo-terminal."""


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
