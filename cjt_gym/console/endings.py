"""Signals that end a program, as one exception, so that what is open is closed in order."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Final

NAMES: Final = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK")
"""Ctrl-C, an order to end, a closed terminal, Ctrl-\\, and Ctrl-Break on Windows."""


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end a program here and are not ignored, as under nohup."""
    numbers = (getattr(signal, name, None) for name in NAMES)
    foreign = (signal.SIG_IGN, None)
    return [n for n in numbers if n is not None and signal.getsignal(n) not in foreign]


@contextlib.contextmanager
def in_order() -> Iterator[None]:
    """Raise an exception on the first signal that ends a program, and ignore all further ones.

    It is KeyboardInterrupt on Ctrl-C and SystemExit on all others. What it lets close is closed
    whole: a second Ctrl-C does not interrupt that.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(f"Stopped by {signal.Signals(number).name}.")

    before = {number: signal.getsignal(number) for number in ending_signals()}
    for number in before:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
