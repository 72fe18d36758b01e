"""The MIT mini-cheetah protocol of CubeMars (T-Motor) AK actuators.

One frame commands angle, velocity, both gains and torque. The drive answers at once with angle,
velocity, torque, temperature and error. All values are integers that span ranges specific to the
model, and refer to the output of the gear.

The watchdog time is set over the serial line, not by this protocol; once it expires, the drive
makes no torque until the next command. No frame shows whether the motor is on. As a drive answers
every frame, it is polled with the one that switches the motor off.

References:
    CubeMars, AK Series Actuator Driver Manual V1.0.8, section 5.3. B. Katz, A low cost modular
    actuator for dynamic robots, MIT (2018), and its motor controller's CAN documentation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan
from typing import Final

from cjt_gym.canbus.protocols.contract import (
    Master,
    Message,
    Mode,
    Settings,
    Step,
    Update,
    frame_of,
    is_plain,
)
from cjt_gym.canbus.protocols.layout import Field, Layout
from cjt_gym.errors import ProtocolError

MODELS: Final = {
    "AK10-9": (12.5, 50.0, 65.0),
    "AK60-6": (12.5, 45.0, 15.0),
    "AK70-10": (12.5, 50.0, 25.0),
    "AK80-6": (12.5, 76.0, 12.0),
    "AK80-9": (12.5, 50.0, 18.0),
    "AK80-64": (12.5, 8.0, 144.0),
    "AK80-80": (12.5, 8.0, 144.0),
    "mini-cheetah": (12.5, 45.0, 18.0),
}
"""Ends of the ranges of angle [rad], velocity [rad/s] and torque [N m] of each model.

The AK models from the manual, the mini cheetah from its firmware. Firmware versions differ: compare
with the drive's own settings, or give the option `ranges`.
"""
KP_MAX: Final = 500.0
KD_MAX: Final = 5.0
ERRORS: Final = {
    0: "none",
    1: "motor too hot",
    2: "too much current",
    3: "supply voltage too high",
    4: "supply voltage too low",
    5: "encoder failed",
    6: "phase currents unequal, or another fault",
}
ENTER, EXIT, ZERO = (bytes([*[0xFF] * 7, last]) for last in (0xFC, 0xFD, 0xFE))
SHORT_REPLY: Final = 6
"""Bytes of a reply of the older firmwares, without temperature and error."""


def _over(name: str, bits: int, low: float, high: float, unit: str, text: str) -> Field:
    return Field(name, bits, "uint", (high - low) / ((1 << bits) - 1), low, unit, text)


def command_layout(ranges: tuple[float, float, float]) -> Layout:
    """Return the layout of a command for ranges of angle, velocity and torque."""
    p, v, t = ranges
    return Layout(
        (
            _over("position", 16, -p, p, "rad", "desired angle of the output"),
            _over("velocity", 12, -v, v, "rad/s", "desired velocity of the output"),
            _over("kp", 12, 0.0, KP_MAX, "N m/rad", "stiffness; sent as zero"),
            _over("kd", 12, 0.0, KD_MAX, "N m s/rad", "damping; sent as zero"),
            _over("torque", 12, -t, t, "N m", "torque added"),
        ),
        "big",
    )


def reply_layout(ranges: tuple[float, float, float], size: int = 8) -> Layout:
    """Return the layout of a reply of 6 or 8 bytes."""
    p, v, t = ranges
    fields = (
        Field("id", 8, text="the drive's address"),
        _over("position", 16, -p, p, "rad", "angle of the output"),
        _over("velocity", 12, -v, v, "rad/s", "velocity of the output"),
        _over("torque", 12, -t, t, "N m", "torque made out from the current"),
        Field("temperature", 8, "int", unit="degC", text="of the motor"),
        Field("error", 8, text="why it stopped by itself", names=ERRORS),
    )
    return Layout(fields if size != SHORT_REPLY else fields[:4], "big")


def ranges_of(settings: Settings) -> tuple[float, float, float]:
    """Return the largest angle [rad], velocity [rad/s] and torque [N m]."""
    if given := settings.options["ranges"]:
        position, velocity, torque = given
        return float(position), float(velocity), float(torque)
    return MODELS[settings.options["model"]]


class MitMaster(Master):
    """Commands one drive; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        ranges = ranges_of(settings)
        self._command = command_layout(ranges)
        self._reply = reply_layout(ranges, settings.options["reply_bytes"])
        names = ("q_m", "dq_m", "tau_m", "temperature")[: len(self._reply.fields) - 1]
        periods = dict.fromkeys(names, settings.period)
        super().__init__(settings, periods, ranges[2] * settings.scaling.gear_ratio)
        self.shows_stop = False
        self._ends = {each.name: each.range for each in self._reply.fields}
        self._reply_id: int = settings.options["reply_id"]

    def configure(self) -> Sequence[Step]:
        """Return the step that checks whether the drive answers."""
        return [self._step("Switch off and look whether it answers", EXIT)]

    def clear(self) -> Sequence[Step]:
        """Return the step that switches the motor off, which clears faults whose cause is gone."""
        return [self._step("Switch off", EXIT)]

    def enable(self) -> Sequence[Step]:
        """Return the steps; the first command replaces any old one in the drive."""
        return [
            Step("Forget the last command", self.command(0.0), self._heard),
            self._step("Switch on", ENTER),
        ]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the frame with both gains zero."""
        torque = self.settings.scaling.drive_torque(tau_m)
        return [self._frame(self._command.encode({"torque": torque}))]

    def commanded(self, frame: Message) -> float | None:
        """Return the torque of a command; frames that set a mode have none."""
        if not is_plain(frame, self.settings.node) or len(frame.data) != self._command.size:
            return None
        if bytes(frame.data) in (ENTER, EXIT, ZERO):
            return None
        return self.settings.scaling.torque(self._command.decode(frame.data)["torque"])

    def poll(self) -> Sequence[Message]:
        """Return the frame that switches the motor off, which the drive answers."""
        return [self._frame(EXIT)]

    def disable(self) -> Sequence[Message]:
        """Return zero torque and the frame that switches the motor off."""
        return [*self.command(0.0), self._frame(EXIT)]

    def decode(self, frame: Message) -> Update | None:
        """Decode a reply; angle and velocity at an end of their range are NaN."""
        if not is_plain(frame, self._reply_id) or not frame.data:
            return None
        if frame.data[0] != self.settings.node:
            return None
        if len(frame.data) != self._reply.size:
            raise ProtocolError(
                f"A reply of drive {self.settings.node} must have {self._reply.size} bytes, got "
                f"{len(frame.data)}. The option reply_bytes says how many its firmware sends."
            )
        values, scaling = self._reply.decode(frame.data), self.settings.scaling
        channels = {
            "q_m": scaling.angle(self._within("position", values)),
            "dq_m": scaling.rate(self._within("velocity", values)),
            "tau_m": scaling.torque(values["torque"]),
        }
        if "temperature" not in values:
            return Update(channels)
        channels["temperature"] = values["temperature"]
        error = int(values["error"])
        text = ERRORS.get(error, f"error {error}") if error else ""
        return Update(channels, Mode.FAULT if error else None, error, text)

    def _within(self, name: str, values: Mapping[str, float]) -> float:
        """Return a value, or NaN at the ends of its range, to which a drive clips it."""
        low, high = self._ends[name]
        return values[name] if low < values[name] < high else nan

    def _frame(self, data: bytes) -> Message:
        return frame_of(self.settings.node, data)

    def _step(self, text: str, data: bytes) -> Step:
        return Step(text, [self._frame(data)], self._heard)

    def _heard(self, frame: Message) -> bool:
        return self.decode(frame) is not None
