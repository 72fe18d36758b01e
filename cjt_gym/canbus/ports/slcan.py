"""A serial-line CAN adapter (slcan, LAWICEL) on a pseudo-terminal, for any slcan client.

Frames are lines of ASCII that end with a carriage return: ``tIIILDD..`` with a standard and
``TIIIIIIIILDD..`` with an extended identifier, ``r`` and ``R`` for remote frames, ``d``/``D`` and
``b``/``B`` for CAN FD without and with a faster data phase. LAWICEL CAN232 manual; FD letters as
in the firmware of the CANable 2.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import time
import tty
from collections.abc import Sequence
from pathlib import Path
from typing import final

import can
from can.util import CAN_FD_DLC, len2dlc

from cjt_gym.errors import ConfigurationError

OK, ERROR = b"\r", b"\a"
LONGEST = 1 << 16  # bytes that wait for a reader; beyond, the oldest or newest are dropped
SETTINGS = b"CSsYLMmWZF"
"""First letters of commands that set the adapter up, which an emulated one takes and forgets."""


@final
class SlcanPort:
    """An slcan adapter on a pseudo-terminal.

    Attributes:
        path: Device that a client opens, such as /dev/pts/3.
    """

    def __init__(self, link: str | None = None) -> None:
        """Open a pseudo-terminal, with a symbolic link to it that a configuration can name."""
        self._link = Path(link) if link else None
        if self._link is not None:
            if self._link.exists() and not self._link.is_symlink():
                raise ConfigurationError(
                    f"The channel {link} of the emulated slcan adapter must be a path that is "
                    "free, or 'pty'. It becomes a link to a pseudo-terminal."
                )
            self._link.unlink(missing_ok=True)
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        if self._link is not None:
            self._link.symlink_to(self.path)
        self._unread = b""
        self._unsent = b""
        self._is_open = False

    @property
    def address(self) -> str:
        """Device that a client opens."""
        return f"slcan {self._link or self.path}"

    def receive(self, timeout: float) -> Sequence[can.Message]:
        """Return the frames that the client sent, waiting up to `timeout` [s]."""
        ready, _, _ = select.select([self._master], [], [], max(timeout, 0.0))
        if not ready:
            return []
        try:
            self._unread += os.read(self._master, 1 << 16)
        except OSError:  # no client has the device open
            return []
        *lines, self._unread = self._unread.split(b"\r")
        self._unread = self._unread[-LONGEST:]
        found = (self._obey(line) for line in lines)
        return [message for message in found if message is not None]

    def send(self, message: can.Message) -> None:
        """Send a frame to the client; it is lost if the client does not read."""
        if self._is_open and not message.is_error_frame:
            self._write(line_of(message))

    def close(self) -> None:
        """Close the pseudo-terminal."""
        os.close(self._master)
        os.close(self._slave)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _write(self, text: bytes) -> None:
        self._unsent += text if len(self._unsent) < LONGEST else b""
        with contextlib.suppress(BlockingIOError):
            self._unsent = self._unsent[os.write(self._master, self._unsent) :]

    def _obey(self, line: bytes) -> can.Message | None:
        """Answer a command; return the frame that it sends, if any."""
        name = line[:1]
        if name in (b"O", b"L"):
            self._is_open = True
        elif name == b"C":
            self._is_open = False
        elif name == b"V":
            self._write(b"V0101\r")
            return None
        elif name == b"N":
            self._write(b"N0001\r")
            return None
        message = parse_line(line)
        known = message is not None or name == b"O" or (name and name in SETTINGS)
        if message is None:
            self._write(OK if known or not name else ERROR)
        return message if self._is_open else None


def parse_line(line: bytes) -> can.Message | None:
    """Return the frame that a line stands for, or None.

    Example:
        >>> parse_line(b"t1232FF00").data.hex()
        'ff00'
    """
    name = line[:1]
    if not name or name not in b"tTrRdDbB":
        return None
    extended = name.isupper()
    at = 9 if extended else 4
    try:
        identifier, code = int(line[1:at], 16), int(line[at : at + 1], 16)
        fd, remote = name in b"dDbB", name in b"rR"
        length = CAN_FD_DLC[code]
        data = b"" if remote else bytes.fromhex(line[at + 1 : at + 1 + 2 * length].decode("ascii"))
    except (ValueError, UnicodeDecodeError):
        return None
    good = identifier <= (0x1FFFFFFF if extended else 0x7FF) and (fd or code <= 8)
    if not good or (not remote and len(data) != length):
        return None
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=name in b"bB",
        dlc=length,
        data=None if remote else data,
        timestamp=time.time(),
    )


def line_of(message: can.Message) -> bytes:
    r"""Return a frame as a line.

    Example:
        >>> line_of(can.Message(arbitration_id=0x123, data=[255, 0], is_extended_id=False))
        b't1232FF00\r'
    """
    letter = "r" if message.is_remote_frame else "t"
    if message.is_fd:
        letter = "b" if message.bitrate_switch else "d"
    wide = message.is_extended_id
    head = f"{letter.upper() if wide else letter}{message.arbitration_id:0{8 if wide else 3}X}"
    data = "" if message.is_remote_frame else message.data.hex().upper()
    return f"{head}{len2dlc(message.dlc):X}{data}\r".encode("ascii")
