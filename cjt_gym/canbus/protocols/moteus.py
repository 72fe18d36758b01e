"""moteus: registers over CAN FD.

Every command is one frame that writes mode, torque and watchdog time and queries the state, which
the drive returns in one frame. Torque control is position mode with all gains zero.

When its watchdog expires, a moteus enters `servo.timeout_mode`, which brakes by default: set it to
0 (stopped). The mode "timeout" is reported as a fault with code 11, because only a stop leaves it.

References:
    mjbots Robotic Systems, moteus: docs/protocol/can.md, docs/protocol/registers.md,
    docs/guides/control-modes.md ("Torque Control").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isnan, nan, tau
from typing import Final

from cjt_gym.canbus.protocols.contract import (
    Master,
    Message,
    Mode,
    Settings,
    Step,
    Update,
    frame_of,
)
from cjt_gym.canbus.protocols.moteus_registers import (
    ASK,
    FAULTS,
    FLOAT,
    INT8,
    INT16,
    SIZES,
    WRITE,
    Replies,
    packed,
    pad,
    read,
    said,
    subframe,
)
from cjt_gym.errors import ProtocolError

STOPPED, FAULTED, POSITION, TIMEOUT = 0, 1, 10, 11
STOP: Final = subframe(WRITE, INT8, 0x000, [STOPPED])
STATE: Final = (
    subframe(ASK, FLOAT, 0x001, 4) + subframe(ASK, INT8, 0x000, 1) + subframe(ASK, INT16, 0x00D, 3)
)
"""Asks for position, velocity, torque, current; mode; voltage, temperature, fault."""
ANSWER: Final = 0x8000


def is_extended(identifier: int) -> bool:
    """Return whether an identifier needs 29 bits."""
    return identifier > 0x7FF


class MoteusMaster(Master):
    """Commands one drive; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        channels = ("q_m", "dq_m", "tau_m", "i", "temperature", "v_bus")
        super().__init__(settings, dict.fromkeys(channels, settings.period))
        source: int = settings.options["source"]
        self._to_drive = ANSWER | source << 8 | settings.node
        self._from_drive = settings.node << 8 | source
        self._to_torque = (
            subframe(WRITE, INT8, 0x000, [POSITION])
            + subframe(WRITE, FLOAT, 0x020, [nan, 0.0])
            + subframe(WRITE, INT8, 0x023, [0.0, 0.0])
            + subframe(WRITE, FLOAT, 0x027, [settings.watchdog])
            + subframe(WRITE, INT8, 0x02B, [0.0])
            + subframe(WRITE, FLOAT, 0x022, 1)
        )
        size = len(self._to_torque) + SIZES[FLOAT]
        self._from_torque = pad(bytes(size) + STATE)[size:]
        self._replies = Replies(read(STATE))
        scaling = settings.scaling
        self._convert: Mapping[int, tuple[str, Callable[[float], float]]] = {
            0x001: ("q_m", lambda turns: scaling.angle(turns * tau)),
            0x002: ("dq_m", lambda turns: scaling.rate(turns * tau)),
            0x003: ("tau_m", scaling.torque),
            0x004: ("i", lambda current: scaling.sign * current),
            0x00D: ("v_bus", float),
            0x00E: ("temperature", float),
        }

    def configure(self) -> Sequence[Step]:
        """Return the step that checks whether the drive answers; each command sets the rest."""
        return [Step("Look whether it answers", self.poll(), lambda frame: bool(self._read(frame)))]

    def clear(self) -> Sequence[Step]:
        """Return the step that stops the drive, which clears faults."""
        return [Step("Stop", self.disable(), self._shows(STOPPED))]

    def enable(self) -> Sequence[Step]:
        """Return the step to position mode without gains."""
        zero = self.command(0.0)
        return [Step("Zero torque", zero, self._shows(POSITION), meanwhile=zero)]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the frame."""
        torque = self.settings.scaling.drive_torque(tau_m)
        if isnan(torque):
            raise ProtocolError(f"Feedforward torque must be a finite number, got {torque}.")
        return [self._frame(self._to_torque + packed(0x022, FLOAT, torque) + self._from_torque)]

    def commanded(self, frame: Message) -> float | None:
        """Return the feedforward torque written by a frame."""
        if frame.is_error_frame or frame.is_remote_frame:
            return None
        if frame.arbitration_id & 0x7FFF != self._to_drive & 0x7FFF:
            return None
        written = said(read(frame.data), "write")
        if 0x000 not in written:
            return None
        torque = written.get(0x022, 0.0) if written[0x000] == POSITION else 0.0
        return self.settings.scaling.torque(torque)

    def poll(self) -> Sequence[Message]:
        """Return the frame that queries the state."""
        return [self._frame(pad(STATE))]

    def disable(self) -> Sequence[Message]:
        """Return the stop frame, which switches the power stage off at once."""
        return [self._frame(pad(STOP + STATE))]

    def decode(self, frame: Message) -> Update | None:
        """Decode an answer."""
        values = self._read(frame)
        if not values:
            return None
        channels = {
            name: to_link(values[number])
            for number, (name, to_link) in self._convert.items()
            if number in values
        }
        return _with_mode(channels, values)

    def _read(self, frame: Message) -> Mapping[int, float]:
        if frame.is_error_frame or frame.is_remote_frame:
            return {}
        if frame.arbitration_id != self._from_drive:
            return {}
        if values := self._replies.values(frame.data):
            return values
        found = read(frame.data)
        if wrong := [each for each in found if each.kind == "error"]:
            raise ProtocolError(
                f"moteus {self.settings.node} has no register {wrong[0].numbers[0]:#05x} of this "
                "type."
            )
        return said(found, "reply")

    def _shows(self, mode: int) -> Callable[[Message], bool]:
        def confirmed(frame: Message) -> bool:
            values = self._read(frame)
            if mode != STOPPED and values.get(0x000) == FAULTED:
                code = _code(values)
                raise ProtocolError(
                    f"moteus {self.settings.node} refuses to run: {FAULTS.get(code, code)}."
                )
            return values.get(0x000) == mode

        return confirmed

    def _frame(self, data: bytes) -> Message:
        identifier = self._to_drive
        return frame_of(identifier, data, extended=is_extended(identifier), fd=True)


def _code(values: Mapping[int, float]) -> int:
    code = values.get(0x00F, 0.0)
    return 0 if isnan(code) else int(code)


def _with_mode(channels: Mapping[str, float], values: Mapping[int, float]) -> Update:
    shown = values.get(0x000)
    if shown is None:
        return Update(channels)
    if shown == FAULTED:
        code = _code(values)
        return Update(channels, Mode.FAULT, code, FAULTS.get(code, f"fault {code}"))
    if shown == TIMEOUT:
        return Update(channels, Mode.FAULT, TIMEOUT, "no command in time")
    preparing = 2 <= shown <= 4
    mode = Mode.DISABLED if shown == STOPPED else Mode.BOOTING if preparing else Mode.ENABLED
    return Update(channels, mode, 0)
