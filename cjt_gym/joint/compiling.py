"""Reports that code is being compiled, which takes up to a minute on first use."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core import event

SILENCE = 1.5
"""Time after which a compilation is reported, and between its dots [s]."""
COMPILING = "compiling, about {seconds} s; compiled code is kept for later runs"
Tell = Callable[[bool], None]


def compiling_in_words() -> str:
    """Return what a compilation is reported as; short if compiled functions are kept already."""
    return COMPILING.format(seconds=5 if _keeps_functions() else 40)


def _keeps_functions() -> bool:
    given = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(given) if given else Path(__file__).parent / "__pycache__"
    return any(home.rglob("*.nbi"))


def while_compiling(tell: Tell) -> None:
    """Call back with True when compiling begins, and with False when it has ended.

    This replaces the notice that Python programs get on standard error.
    """
    _listener.tell = tell


class Notice:
    """Writes a line to standard error if a compilation takes long, and a dot now and then."""

    def __init__(self) -> None:
        """Prepare the first line, which says how long it takes; later ones are short."""
        self._words = ""
        self._over = threading.Event()

    def __call__(self, begins: bool) -> None:
        """Begin or end to wait."""
        if begins:
            self._words = self._words or compiling_in_words()
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
