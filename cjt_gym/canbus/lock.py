"""A lock that lets one process at a time use a node; it is released when the process dies.

Its name follows from the identity of the bus, and its folder is the same for all processes of the
machine. A file there that is not a lock is left alone.
"""

from __future__ import annotations

import contextlib
import ipaddress
import os
import re
import socket
import stat
from pathlib import Path
from typing import Final, final

from cjt_gym.canbus.settings import BusSettings
from cjt_gym.disk import lock
from cjt_gym.errors import HardwareError

FOLDER: Final = Path(os.environ.get("PROGRAMDATA", "C:\\") if os.name == "nt" else "/tmp")
WIDTH: Final = 16
"""Bytes of a lock: the number of the process that took it last, and spaces."""
HERE: Final = "this-machine"


@final
class NodeLock:
    """A lock on one node of a bus, held until `release`.

    Attributes:
        path: Its file, which is never deleted.

    Raises:
        HardwareError: Another process holds it, or its path is taken by something else.
    """

    def __init__(self, bus: str, node: int) -> None:
        """Take the lock."""
        name = re.sub(r"[^A-Za-z0-9]+", "-", f"{bus}-{node}")
        self.path = FOLDER / f"cjt-gym-{name}.lock"
        self._file = _opened(self.path)
        try:
            os.lseek(self._file, WIDTH, os.SEEK_SET)  # on Windows, what is locked cannot be read
            lock(self._file)
        except OSError:
            holder = _content(self._file).decode("ascii", "replace").strip() or "unknown"
            os.close(self._file)
            raise HardwareError(
                f"Node {node} of {bus} is commanded by another process (number {holder}, lock "
                f"{self.path}). Stop that one first."
            ) from None
        with contextlib.suppress(OSError):  # a lock of another user is only read
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, str(os.getpid()).encode().ljust(WIDTH))

    def release(self) -> None:
        """Release the lock; a second call has no effect."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _opened(path: Path) -> int:
    """Return the open file of a lock, creating it if needed."""
    safe = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    for flags in (os.O_RDWR, os.O_RDWR | os.O_CREAT | os.O_EXCL, os.O_RDONLY):
        try:
            file = os.open(path, flags | safe, 0o666)
        except OSError as error:
            reason = str(error)
            continue
        if not path.is_symlink() and _is_lock(file):
            return file
        os.close(file)
        reason = "cjt-gym did not make it"
        break
    raise HardwareError(
        f"{path} must be the lock of a node, but cannot be used: {reason}. Move it away."
    )


def _is_lock(file: int) -> bool:
    """Return whether an open file is a lock or empty, and has no other name."""
    known = os.fstat(file)
    is_own = stat.S_ISREG(known.st_mode) and known.st_nlink == 1 and known.st_size <= WIDTH
    return is_own and re.fullmatch(rb"\d* *", _content(file)) is not None


def _content(file: int) -> bytes:
    os.lseek(file, 0, os.SEEK_SET)
    return os.read(file, WIDTH)


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
