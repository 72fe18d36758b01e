"""Emulated joints on a bus: several on one, and one or several for clients in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import final

import can

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.emulator import Emulator, medium_of
from cjt_gym.canbus.ports import Port
from cjt_gym.canbus.settings import EmulatorSettings
from cjt_gym.canbus.wire import Due, Wire
from cjt_gym.joint import Joint

SLOWEST = 0.02
"""Time that an emulator may fall behind [s]; beyond, its time stands still instead.

A drive never sends a burst of old frames.
"""


@final
class EmulatedArm:
    """Emulators that share time and bus; used like a single one.

    Attributes:
        emulators: Emulator of each joint.
        medium: The wire that all frames share, if the bus has a bit rate.
        now: Current time of the emulation [s].
    """

    def __init__(
        self, configs: Sequence[HardwareConfig], joints: Sequence[Joint] | None = None
    ) -> None:
        """Boot all nodes at time zero."""
        self.emulators = [
            Emulator(
                replace(
                    config,
                    bus=replace(config.bus, bitrate=None),
                    emulator=replace(config.emulator, seed=config.emulator.seed + 100 * k),
                ),
                None if joints is None else joints[k],
            )
            for k, config in enumerate(configs)
        ]
        self.medium = medium_of(configs[0])
        self._in = Wire(EmulatorSettings(), 0, self.medium)
        self._out = Wire(EmulatorSettings(), 0, self.medium)
        self.now = 0.0
        self._collect()

    @property
    def torques(self) -> list[float]:
        """Motor torque that acts at each joint [N m]."""
        return [emulator.torque for emulator in self.emulators]

    def send(self, messages: Sequence[can.Message]) -> None:
        """Put frames of a master on the bus now; all nodes receive them."""
        for message in messages:
            self._in.put(self.now, message)
        self._deliver(self.now)

    def receive(self) -> list[Due]:
        """Return the frames for the master that have arrived by now."""
        return self._out.take(self.now)

    def next(self) -> float:
        """Return the time of the next event that a master could notice [s]."""
        return min(self._in.next(), self._out.next(), *(e.next() for e in self.emulators))

    def advance(self, t: float) -> None:
        """Advance the time to `t` [s]."""
        while (next_ := self._in.next()) <= t:
            self._advance_all(next_)
            self._deliver(next_)
        self._advance_all(t)

    def _advance_all(self, t: float) -> None:
        for emulator in self.emulators:
            emulator.advance(t)
        self.now = max(self.now, t)
        self._collect()

    def _deliver(self, t: float) -> None:
        messages = [due.message for due in self._in.take(t)]
        if messages:
            for emulator in self.emulators:
                if heeded := [message for message in messages if emulator.heeds(message)]:
                    emulator.send(heeded)
            self._collect()

    def _collect(self) -> None:
        found = [due for emulator in self.emulators for due in emulator.receive()]
        for due in sorted(found, key=lambda due: due.t):
            self._out.put(due.t, due.message)


def emulator_of(
    configs: Sequence[HardwareConfig], joints: Sequence[Joint] | None = None
) -> Emulator | EmulatedArm:
    """Return the emulator of one joint, or the `EmulatedArm` of several."""
    if len(configs) > 1:
        return EmulatedArm(configs, joints)
    return Emulator(configs[0], None if joints is None else joints[0])


def serve(
    emulator: Emulator | EmulatedArm, port: Port, speed: float, stopped: Callable[[], bool]
) -> None:
    """Run an emulator on a port until it is stopped; speed is that of its time over the clock."""

    def hand_out() -> None:
        for due in emulator.receive():
            due.message.timestamp = time.time()
            port.send(due.message)

    begin = time.perf_counter() - emulator.now / speed
    while not stopped():
        now = (time.perf_counter() - begin) * speed
        if now - emulator.now > SLOWEST * speed:
            begin += (now - emulator.now) / speed
            now = emulator.now
        emulator.advance(now)
        hand_out()
        if messages := port.receive((emulator.next() - emulator.now) / speed):
            emulator.advance((time.perf_counter() - begin) * speed)
            emulator.send(messages)
            hand_out()
