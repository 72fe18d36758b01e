"""Times of arrival by the clock of an interface."""

from __future__ import annotations

import time

import can
import numpy as np
import pytest

from cjt_gym.canbus.link import BusLink
from cjt_gym.canbus.settings import read_bus
from cjt_gym.canbus.stamps import JUMP, WINDOW, StampClock, clock_of
from cjt_gym.errors import ConfigurationError, HardwareError


@pytest.mark.parametrize("drift", [0.0, 1e-4, -1e-4])
def test_a_frame_that_waits_is_as_old_as_it_is(drift: float) -> None:
    rng, clock = np.random.default_rng(0), StampClock("hardware")
    sent = 1e-3 * np.arange(5000)
    waits = 1e-4 + rng.exponential(2e-4, len(sent))
    found = [
        clock.arrived(1e9 + (1.0 + drift) * t, t + wait)
        for t, wait in zip(sent.tolist(), waits.tolist(), strict=True)
    ]
    late = np.array(found)[500:] - sent[500:]
    assert late.min() >= 0.0
    assert late.max() < 1e-4 + 2.0 * WINDOW * abs(drift) + 2e-5
    assert all(at <= t + wait for at, t, wait in zip(found, sent, waits + 1e-6, strict=True))
    assert clock.kind == "hardware"


@pytest.mark.parametrize("jump", [5.0, -5.0, 0.03])
def test_a_clock_that_is_set_makes_no_frame_old(jump: float) -> None:
    clock = StampClock("hardware")
    for k in range(1000):
        received = 1e-3 * k
        stamp = 100.0 + received + (jump if k >= 500 else 0.0)
        assert received - clock.arrived(stamp, received) == pytest.approx(0.0, abs=1e-9)


def test_a_small_jump_back_is_forgotten_and_never_hides_a_late_frame() -> None:
    clock, age = StampClock("hardware"), []
    for k in range(2000):
        received = 1e-3 * k
        stamp = 100.0 + received - (0.5 * JUMP if k >= 500 else 0.0)
        age.append(received - clock.arrived(stamp, received))
    assert age[500] == pytest.approx(0.5 * JUMP)
    assert age[-1] == pytest.approx(0.0, abs=1e-9)


HELD = 0.05
"""Time for which a driver held every third frame [s]."""


class Stamped:
    """A bus with thirty frames, of which every third was stamped some time ago."""

    def __init__(self, stamps: bool) -> None:
        self.stamps, self.times = stamps, list[float]()

    def recv(self, timeout: float) -> can.Message | None:
        if len(self.times) == 30:
            time.sleep(timeout)
            return None
        held = HELD if len(self.times) % 3 == 2 else 0.0
        self.times.append(time.perf_counter())
        stamp = 1e6 + self.times[-1] - held if self.stamps else 0.0
        return can.Message(arbitration_id=1, timestamp=stamp)

    def shutdown(self) -> None:
        pass


@pytest.mark.parametrize("stamps", [True, False])
def test_the_link_tells_when_frames_arrived_and_by_whose_clock(stamps: bool) -> None:
    bus = Stamped(stamps)
    link = BusLink(bus, clock_of("pcan", "auto"))  # type: ignore[arg-type]
    end = time.perf_counter() + 20.0
    found = []
    while len(found) < 30 and time.perf_counter() < end:
        found += link.receive()
        time.sleep(0.01)
    link.close()
    late = np.array([t for t, _ in found]) - bus.times
    assert link.stamps == ("hardware" if stamps else "reception")
    assert np.median(late[0::3]) >= -1e-6
    assert (np.median(late[2::3]) < -0.5 * HELD) == stamps


@pytest.mark.parametrize(
    ("interface", "asked", "kind"),
    [
        ("socketcan", "auto", "kernel"),
        ("kvaser", "auto", "hardware"),
        ("kvaser", "reception", "reception"),
        ("socketcand", "auto", "reception"),
        ("socketcand", "interface", "interface"),
    ],
)
def test_interfaces_with_a_clock_are_known(interface: str, asked: str, kind: str) -> None:
    given = read_bus({"interface": interface, "channel": "x", "stamps": asked}, "[bus]")
    clock = clock_of(given.interface, given.stamps)
    clock.arrived(1.0, 2.0)
    assert clock.kind == kind


def test_another_word_for_stamps_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="auto, interface, reception, got 'gps'"):
        read_bus({"interface": "virtual", "channel": "x", "stamps": "gps"}, "[bus]")


class Lost:
    """A bus whose server is gone; its driver makes a traceback of that, as socketcand's does."""

    def recv(self, timeout: float) -> can.Message | None:
        try:
            raise ConnectionResetError(104, "Connection reset by peer")
        except OSError as error:
            text = "Traceback (most recent call last):\n  line 1, in recv"
            raise can.CanOperationError(text) from error

    def shutdown(self) -> None:
        pass


def test_a_lost_bus_says_why_without_a_traceback() -> None:
    link = BusLink(Lost())  # type: ignore[arg-type]
    said, end = "", time.perf_counter() + 20.0
    while not said and time.perf_counter() < end:
        try:
            link.receive()
        except HardwareError as error:
            said = str(error)
        time.sleep(0.01)
    link.close()
    assert said == "The bus is lost: [Errno 104] Connection reset by peer."
