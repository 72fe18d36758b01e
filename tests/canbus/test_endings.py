"""Signals that end a program become one exception, and a second one does not disturb."""

from __future__ import annotations

import os
import signal

import pytest

from cjt_gym.console.endings import in_order


@pytest.mark.parametrize("name", ["SIGHUP", "SIGTERM", "SIGQUIT", "SIGINT"])
def test_first_signal_ends_in_order_and_further_ones_are_ignored(name: str) -> None:
    number = getattr(signal, name)
    usual = signal.default_int_handler if name == "SIGINT" else signal.SIG_DFL
    inherited = signal.signal(number, usual)  # in the background of a shell it may be ignored
    before, cleaned = signal.getsignal(number), []

    def run() -> None:
        try:
            os.kill(os.getpid(), number)
        finally:
            os.kill(os.getpid(), number)
            os.kill(os.getpid(), signal.SIGTERM)
            cleaned.append(True)

    with pytest.raises((SystemExit, KeyboardInterrupt)) as caught, in_order():
        run()
    assert cleaned
    assert isinstance(caught.value, KeyboardInterrupt) == (name == "SIGINT")
    assert signal.getsignal(number) is before
    signal.signal(number, inherited)


def test_what_is_ignored_stays_ignored_as_under_nohup() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with in_order():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
