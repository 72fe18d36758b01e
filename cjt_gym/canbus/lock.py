"""One process commands a node: a lock that the operating system gives back when a process dies."""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path
from typing import final

from cjt_gym.errors import HardwareError


@final
class NodeLock:
    """A lock on one node of one bus, held from its making to `release`.

    Raises:
        HardwareError: Another process holds it.
    """

    def __init__(self, bus: str, node: int) -> None:
        """Take the lock.

        Args:
            bus: What tells the bus from others on this machine.
            node: Number of the node.
        """
        name = re.sub(r"[^A-Za-z0-9]+", "-", f"{bus}-{node}")
        self.path = Path(tempfile.gettempdir()) / f"cjt-gym-{name}.lock"
        self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(self._file)
        except OSError:
            holder = os.read(self._file, 32).decode("ascii", "replace").strip() or "unknown"
            os.close(self._file)
            raise HardwareError(
                f"Node {node} of {bus} is commanded by another process (number {holder}, lock "
                f"{self.path}). Stop that one first."
            ) from None
        os.ftruncate(self._file, 0)
        os.write(self._file, str(os.getpid()).encode())

    def release(self) -> None:
        """Give the lock back; a second call does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _lock(file: int) -> None:
    if os.name == "nt":
        import msvcrt

        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
