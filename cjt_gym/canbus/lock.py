"""A lock that lets one process at a time use a node; it is released when the process dies.

Its name follows from the identity of the bus, and its folder is the same for all processes of the
machine. A file there that is not a lock is left alone.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from pathlib import Path
from typing import Final, final

from cjt_gym.errors import HardwareError

FOLDER: Final = Path(os.environ.get("PROGRAMDATA", "C:\\") if os.name == "nt" else "/tmp")
WIDTH: Final = 16
"""Bytes of a lock: the number of the process that took it last, and spaces."""


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
            _lock(self._file)
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


def _lock(file: int) -> None:
    if os.name == "nt":
        import msvcrt

        os.lseek(file, WIDTH, os.SEEK_SET)  # beyond what others may want to read
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
