"""Signs of life: a command that says nothing for two seconds says what it is doing.

In a terminal that is one line that is overwritten; in a file or a pipe it is a line that grows by a
dot. Progress bars are refreshed instead.
"""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import Any, Final

SILENCE: Final = 1.5
"""How long a command says nothing [s]; code that cannot be interrupted adds up to a second."""
LOADING, WORKING = "loading", "working"
ERASE: Final = "\r\x1b[K"


class Watched:
    """A stream that reports every write; everything else is passed on to the stream."""

    def __init__(self, stream: Any, alive: Alive) -> None:
        self._stream, self._alive = stream, alive

    def write(self, text: str) -> int:
        """Write a text, after the sign of life that may stand there."""
        self._alive.heard()
        written: int = self._stream.write(text)
        return written

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Alive:
    """Watches what a command writes, and writes to standard error where that is nothing."""

    def __init__(self, until_a_word: bool = False) -> None:
        """Prepare.

        With `until_a_word` it is silent for good once the command has written anything, for those
        that then wait for others.
        """
        self.doing, self._until_a_word = LOADING, until_a_word
        self._lock, self._over = threading.RLock(), threading.Event()
        self._last, self._begun, self._open = time.monotonic(), time.monotonic(), ""
        self._told = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Alive:
        self._streams = sys.stdout, sys.stderr
        self._terminal = sys.stderr.isatty()
        sys.stdout, sys.stderr = (Watched(s, self) for s in self._streams)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        self._close()
        sys.stdout, sys.stderr = self._streams

    def heard(self) -> None:
        """Note that the command has written something."""
        self._close()
        self._last = self._begun = time.monotonic()
        if self._until_a_word:
            self._over.set()

    def watch_compiler(self) -> None:
        """Say it when something is compiled."""
        from cjt_gym.joint.kernel.compiling import COMPILING, while_compiling

        def told(compiling: bool) -> None:
            self.doing = COMPILING if compiling else WORKING
            if compiling and not self._told and not self._over.is_set():
                self._told = True
                self._beat()

        while_compiling(told)

    def _run(self) -> None:
        while not self._over.wait(0.2):
            if time.monotonic() - self._last > SILENCE:
                self._beat()

    def _beat(self) -> None:
        self._last = time.monotonic()
        bars = _bars()
        if not bars:
            self._write()
        for bar in bars:  # not under our lock: an update of a bar holds tqdm's and takes ours
            bar.refresh()

    def _write(self) -> None:
        with self._lock:
            stream = self._streams[1]
            if self._terminal:
                passed = self._last - self._begun
                stream.write(f"{ERASE}cjt-gym: {self.doing} ({passed:.0f} s)")
                self._open = ERASE
            elif self._open == f"{self.doing}\n":
                stream.write(".")
            else:
                self._close()
                stream.write(f"cjt-gym: {self.doing} ...")
                self._open = f"{self.doing}\n"
            stream.flush()

    def _close(self) -> None:
        with self._lock:
            if self._open:
                self._streams[1].write(self._open if self._terminal else "\n")
                self._streams[1].flush()
            self._open = ""


def _bars() -> list[Any]:
    shown = getattr(sys.modules.get("tqdm"), "tqdm", None)
    return [bar for bar in getattr(shown, "_instances", ()) if not bar.disable]
