"""A master and a firmware on one line, without bus, clock or threads."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

from can import Message

from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.protocols.contract import Limits, Mode, Settings, Step, Update
from cjt_gym.errors import ProtocolError

NODE = 3
WATCHDOG = 0.05
"""Of every emulated drive, as set in it before [s]."""
DRIVES: dict[str, dict[str, Any]] = {
    "mit": {"node": NODE, "model": "AK80-9", "sign": -1, "offset": 0.25},
    "odrive": {"node": NODE, "sign": -1, "offset": 1.5},
    "moteus": {"node": NODE, "gear_ratio": 2.0, "sign": -1, "offset": 0.5},
    "cia402": {"node": NODE, "sign": -1, "offset": 0.5, "rated_torque": 0.1, "rated_current": 4.0},
    "dbc": {"file": "example_drive"},
}
"""A configuration of a drive for each protocol."""


def settings_for(name: str, limits: Limits | None = None, **more: Any) -> Settings:
    limits = replace(limits or Limits(), watchdog=WATCHDOG)
    return settings_of(PROTOCOLS[name], {**DRIVES[name], **more}, n=50.0, limits=limits)


class Line:
    """Both ends of a protocol; `tick` is one period of the master.

    Attributes:
        sent: All frames of the master.
        heard: All frames of the drive.
        now: Time [s].
        joint: What the emulated joint shows, link side.
    """

    def __init__(self, settings: Settings, name: str) -> None:
        self.master = PROTOCOLS[name].master(settings)
        self.firmware = PROTOCOLS[name].firmware(settings)
        self.settings = settings
        self.sent: list[Message] = []
        self.heard: list[Message] = []
        self.now = 0.0
        self.joint: dict[str, float] = {"q_m": 0.0, "dq_m": 0.0, "tau_m": 0.0}
        self.channels: dict[str, float] = {}
        self.mode: Mode | None = None
        self.error: int | None = None
        self._hear(self.firmware.boot(0.0))

    def send(self, frames: Any) -> list[Message]:
        """Hand frames to the drive; return what it says."""
        self.sent += frames
        answers = [each for frame in frames for each in self.firmware.receive(frame, self.now)]
        return self._hear(answers)

    def pass_time(self, seconds: float, each: Callable[[], Any] | None = None) -> list[Message]:
        """Let the drive live for a while; `each` gives frames once a millisecond."""
        heard: list[Message] = []
        for _ in range(round(seconds / 1e-3)):
            self.now += 1e-3
            if each:
                heard += self.send(each())
            heard += self._hear(self.firmware.update(self.joint, self.now))
        return heard

    def run(self, steps: Any) -> None:
        """Do steps as a plant does: each is confirmed before the next."""
        for step in steps:
            assert self._confirmed(step) or step.optional, step.text

    def start(self) -> None:
        """Up to enabled."""
        self.pass_time(0.3)
        self.run(self.master.configure())
        self.run(self.master.clear())
        self.run(self.master.enable())

    def show(self, joint: Mapping[str, float]) -> None:
        """Let the joint have other values."""
        self.joint = dict(joint)

    def survive(self, frame: Message) -> None:
        """Hand any frame to both ends: it means something, or is one clear error."""
        with suppress(ProtocolError):
            update = self.master.decode(frame)
            assert update is None or set(update.channels) <= self.master.channels
        with suppress(ProtocolError):
            self.master.commanded(frame)
        for answer in self.firmware.receive(frame, self.now):
            assert isinstance(answer, Message)
        self.firmware.update(self.joint, self.now)
        assert math.isfinite(self.firmware.torque)

    def _confirmed(self, step: Step) -> bool:
        heard = self.send(step.frames)
        if step.confirmed is None:
            return True
        end = self.now + step.timeout
        while True:
            if any(map(step.confirmed, heard)):
                return True
            if self.now > end:
                return False
            heard = self.pass_time(1e-3, lambda: step.meanwhile)

    def _hear(self, frames: Any) -> list[Message]:
        for update in self._updates(frames):
            self.channels.update(update.channels)
            self.mode = update.mode or self.mode
            self.error = self.error if update.error is None else update.error
        self.heard += frames
        return list(frames)

    def _updates(self, frames: Any) -> Iterator[Update]:
        for frame in frames:
            update = self.master.decode(frame)
            if update is not None:
                yield update


def started(name: str, **more: Any) -> Line:
    """Return both ends of a protocol with the drive enabled; more are settings of the drive."""
    line = Line(settings_for(name, **more), name)
    line.start()
    return line
