"""Reports that code is being compiled, which takes some minutes on first use."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

from numba.core import event

SILENCE = 1.5
"""Time after which a compilation is reported, and between its dots [s]."""
COMPILING = "compiling, up to two minutes; compiled code is kept for later runs"
Tell = Callable[[bool], None]


def while_compiling(tell: Tell) -> None:
    """Call back with True when compiling begins, and with False when it has ended.

    This replaces the notice that Python programs get on standard error.
    """
    _listener.tell = tell


class Notice:
    """Writes a line to standard error if a compilation takes long, and a dot now and then."""

    def __init__(self) -> None:
        """Prepare the first line; later ones are shorter."""
        self._words = ""
        self._over = threading.Event()

    def __call__(self, begins: bool) -> None:
        """Begin or end to wait."""
        if begins:
            self._words = self._words or COMPILING
            self._over = threading.Event()
            threading.Thread(target=self._watch, args=(self._over,), daemon=True).start()
        else:
            self._over.set()

    def _watch(self, over: threading.Event) -> None:
        text, end = f"cjt_gym: {self._words} ...", ""
        while not over.wait(SILENCE):
            sys.stderr.write(text)
            sys.stderr.flush()
            self._words, text, end = "compiling", ".", "\n"
        sys.stderr.write(end)


class _Compiler(event.Listener):
    """Counts what is being compiled."""

    def __init__(self, tell: Tell) -> None:
        self.tell, self._depth = tell, 0

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self.tell(True)

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.tell(False)


_listener = _Compiler(Notice())
event.register("numba:compile", _listener)  # type: ignore[no-untyped-call]
