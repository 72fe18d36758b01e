"""Identify a bus regardless of how it is spelled."""

from __future__ import annotations

import ipaddress
import os
import re
import socket

from cjt_gym.canbus.settings import BusSettings

HERE = "this-machine"


def bus_identity(settings: BusSettings) -> str:
    """Return a name that is the same for every spelling of a bus, and differs between buses."""
    interface, options = settings.interface.lower(), settings.options
    if interface == "socketcand":
        host = machine_of(str(options.get("host", settings.host)))
        return f"{interface}-{host}-{options.get('port', settings.port)}-{settings.channel}"
    return f"{interface}-{_device(settings.channel)}"


def machine_of(host: str) -> str:
    """Return a single name for all addresses and names of a machine.

    A name that cannot be resolved is returned unchanged; connecting will fail, too.
    """
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return host.lower()
    addresses = sorted({str(entry[4][0]) for entry in found})
    return HERE if any(map(_is_here, addresses)) else addresses[0]


def _is_here(address: str) -> bool:
    """Return whether an address belongs to this machine: only such can be bound."""
    plain = ipaddress.ip_address(address.split("%")[0])
    if plain.is_loopback or plain.is_unspecified:
        return True
    family = socket.AF_INET6 if plain.version == 6 else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((address, 0))
    except OSError:
        return False
    return True


def _device(channel: str) -> str:
    """Return the device behind a path such as those in /dev/serial, otherwise the channel."""
    path = re.sub(r"@\d+$", "", channel)  # slcan: the baud rate of the serial line
    return os.path.realpath(path) if os.path.isabs(path) else channel
