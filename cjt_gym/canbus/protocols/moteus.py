"""moteus: registers over CAN FD.

Every command is one frame that writes mode, torque and watchdog time and asks for the state, which
comes back in one frame. Torque control is the position mode with all of its gains at zero.

After its watchdog a moteus does what `servo.timeout_mode` says, which is braking where it was not
set: set it to 0 (stopped). The mode "timeout" is shown here as a fault with the code 11, because
only a stop leaves it.

References:
    mjbots Robotic Systems, moteus: docs/protocol/can.md, docs/protocol/registers.md,
    docs/guides/control-modes.md ("Torque Control").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf, isnan, nan, tau
from typing import Final

from cjt_gym.canbus.protocols.contract import (
    NO_CHANNELS,
    Fault,
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
    READ_ERROR,
    REGISTERS,
    REPLY,
    STEPS,
    WRITE,
    Subframe,
    field_of,
    pad,
    read,
    subframe,
)
from cjt_gym.canbus.protocols.power_stage import PowerStage
from cjt_gym.canbus.protocols.row import DriveProtocol, Option, Register
from cjt_gym.errors import ProtocolError

__all__ = ["MOTEUS", "MoteusFirmware", "MoteusMaster"]

STOPPED, FAULTED, POSITION, TIMEOUT = 0, 1, 10, 11
STOP: Final = subframe(WRITE, INT8, 0x000, [STOPPED])
STATE: Final = (
    subframe(ASK, FLOAT, 0x001, 4) + subframe(ASK, INT8, 0x000, 1) + subframe(ASK, INT16, 0x00D, 3)
)
"""Asks for position, velocity, torque, current; mode; voltage, temperature, fault."""
BROADCAST: Final = 0x7F
LARGEST: Final = 3.4e38
ANSWER: Final = 0x8000
CODES: Final = {
    Fault.OVER_TEMPERATURE: 38,
    Fault.OVER_CURRENT: 33,
    Fault.OVER_VOLTAGE: 34,
    Fault.UNDER_VOLTAGE: 40,
    Fault.OVER_SPEED: 50,
    Fault.ENCODER: 35,
    Fault.STOPPED: 44,
    Fault.OTHER: 37,
}
KP, KD = 4.0, 0.05
"""Position gains of an emulated drive [N m/rev, N m/(rev/s)], the defaults of a new one."""


def _extended(identifier: int) -> bool:
    return identifier > 0x7FF


class MoteusMaster:
    """Commands one drive; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.channels = frozenset({"q_m", "dq_m", "tau_m", "i", "temperature", "v_bus"})
        self.periods = dict.fromkeys(self.channels, settings.period)
        self.torque_range = (-inf, inf)
        source: int = settings.options["source"]
        self._to_drive = ANSWER | source << 8 | settings.node
        self._from_drive = settings.node << 8 | source
        self._gains = (
            subframe(WRITE, INT8, 0x000, [POSITION])
            + subframe(WRITE, FLOAT, 0x020, [nan, 0.0])
            + subframe(WRITE, INT8, 0x023, [0.0, 0.0])
            + subframe(WRITE, FLOAT, 0x027, [settings.watchdog])
            + subframe(WRITE, INT8, 0x02B, [0.0])
        )
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
        """Return the one step that looks whether the drive answers; the rest is in each command."""
        return [Step("Look whether it answers", self.poll(), lambda frame: bool(self._read(frame)))]

    def clear(self) -> Sequence[Step]:
        """Return the one step; a stop clears faults."""
        return [Step("Stop", [self._frame(STOP + STATE)], self._shows(STOPPED))]

    def enable(self) -> Sequence[Step]:
        """Return the one step to position mode without gains."""
        zero = self.command(0.0)
        return [Step("Zero torque", zero, self._shows(POSITION), meanwhile=zero)]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the one frame."""
        torque = self.settings.scaling.drive_torque(tau_m)
        if isnan(torque):
            raise ProtocolError(f"Feedforward torque must be a finite number, got {torque}.")
        return [self._frame(self._gains + subframe(WRITE, FLOAT, 0x022, [torque]) + STATE)]

    def commanded(self, frame: Message) -> float | None:
        """Return the feedforward torque that is written."""
        if frame.is_error_frame or not frame.is_fd:
            return None
        if frame.arbitration_id & 0x7FFF != self._to_drive & 0x7FFF:
            return None
        written = {each.number: each.value for each in read(frame.data) if each.kind == "write"}
        if 0x000 not in written:
            return None
        torque = written.get(0x022, 0.0) if written[0x000] == POSITION else 0.0
        return self.settings.scaling.torque(torque)

    def poll(self) -> Sequence[Message]:
        """Return the frame that asks for the state."""
        return [self._frame(STATE)]

    def disable(self) -> Sequence[Message]:
        """Return the frame that stops; the power stage is off at once."""
        return [self._frame(STOP + STATE)]

    def decode(self, frame: Message) -> Update | None:
        """Return what an answer says."""
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
        if frame.is_error_frame or not frame.is_fd:
            return {}
        if frame.arbitration_id != self._from_drive:
            return {}
        found = list(read(frame.data))
        if wrong := [each for each in found if each.kind == "error"]:
            raise ProtocolError(
                f"moteus {self.settings.node} has no register {wrong[0].number:#05x} of this type."
            )
        return {each.number: each.value for each in found if each.kind == "reply"}

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
        return frame_of(identifier, pad(data), extended=_extended(identifier), fd=True)


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


class MoteusFirmware:
    """Answers as a drive does; see :class:`~cjt_gym.canbus.protocols.contract.Firmware`."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.stage = PowerStage(settings.limits, settings.watchdog)
        self._told: dict[int, float] = {}
        self._held = 0.0
        self._channels: Mapping[str, float] = NO_CHANNELS

    @property
    def mode(self) -> Mode:
        """What it is doing."""
        return self.stage.mode

    @property
    def fault(self) -> Fault | None:
        """Why it stopped by itself."""
        return self.stage.fault

    @property
    def torque(self) -> float:
        """Motor torque [N m, link side]."""
        return self.stage.torque

    def boot(self, now: float) -> Sequence[Message]:
        """Start; it says nothing."""
        self.stage.boot()
        self._told = {}
        return []

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a frame for this drive; answer if it asks for an answer."""
        if frame.is_error_frame or frame.is_remote_frame or frame.arbitration_id > 0xFFFF:
            return []
        if frame.arbitration_id & 0xFF not in (self.settings.node, BROADCAST):
            return []
        try:
            found = list(read(frame.data))
        except ProtocolError:
            return []
        self._write({each.number: each.value for each in found if each.kind == "write"}, now)
        asked = [each for each in found if each.kind == "ask"]
        if not asked or not frame.arbitration_id & ANSWER:
            return []
        identifier = self.settings.node << 8 | frame.arbitration_id >> 8 & 0x7F
        data = b"".join(map(self._answer, asked))
        if len(data) > 64:
            return []
        return [frame_of(identifier, pad(data), extended=_extended(identifier), fd=True)]

    def update(self, channels: Mapping[str, float], now: float) -> Sequence[Message]:
        """Take the joint's values; it reports only when asked."""
        self._channels = channels
        self._act()
        self.stage.supervise(channels, now)
        return []

    def fail(self, fault: Fault) -> None:
        """Fault now."""
        self.stage.fail(fault)

    def _write(self, written: dict[int, float], now: float) -> None:
        mode = written.get(0x000)
        if mode == STOPPED:
            self.stage.disable()
            self.stage.clear()
        elif mode == POSITION and self.stage.enable(now):
            self._told = written
            self._held = self._seen(0x001)
            time = written.get(0x027, 0.0)
            self.stage.watchdog = 0.0 if isnan(time) else time or self.settings.watchdog
            self.stage.feed(now)
            self._act()

    def _act(self) -> None:
        """Make the torque of the position mode; it keeps no integral."""
        told = self._told
        if not told:
            return
        position = told.get(0x020, 0.0)
        error = (self._held if isnan(position) else position) - self._seen(0x001)
        torque = KP * told.get(0x023, 1.0) * error + told.get(0x022, 0.0)
        torque += KD * told.get(0x024, 1.0) * (told.get(0x021, 0.0) - self._seen(0x002))
        most = told.get(0x025, nan)
        torque = torque if isnan(most) else min(max(torque, -most), most)
        self.stage.demand(self.settings.scaling.torque(torque))

    def _answer(self, asked: Subframe) -> bytes:
        register = REGISTERS.get(asked.number)
        if register is None:
            return bytes([READ_ERROR, *subframe(ASK, INT8, asked.number, 1)[1:], 1])
        value = self._seen(asked.number)
        value = value if abs(value) < LARGEST else nan
        if asked.type != FLOAT:
            low, high = field_of(asked.number, asked.type).range
            value = min(max(value, low + STEPS[register.quantity][1][asked.type]), high)
        return subframe(REPLY, asked.type, asked.number, [value])

    def _seen(self, number: int) -> float:
        scaling, channels = self.settings.scaling, self._channels
        match number:
            case 0x000:
                return self._shown_mode()
            case 0x001 | 0x006:
                return scaling.drive_angle(channels.get("q_m", 0.0)) / tau
            case 0x002:
                return scaling.drive_rate(channels.get("dq_m", 0.0)) / tau
            case 0x003:
                return scaling.drive_torque(channels.get("tau_m", self.torque))
            case 0x004:
                return scaling.sign * channels.get("i", 0.0)
            case 0x00A | 0x00E:
                return channels.get("temperature", 25.0)
            case 0x00D:
                return channels.get("v_bus", 0.0)
            case 0x00F:
                return CODES.get(self.fault, 0) if self.fault else 0
            case _:
                return self._told.get(number, 0.0)

    def _shown_mode(self) -> int:
        if self.fault is Fault.WATCHDOG:
            return TIMEOUT
        if self.mode is Mode.FAULT:
            return FAULTED
        return POSITION if self.mode is Mode.ENABLED else STOPPED


def _registers() -> Sequence[Register]:
    return [
        Register(
            f"{row.number:#05x}",
            "both" if row.writable else "from drive",
            row.name,
            [row.field(FLOAT)],
            "8, 16, 32 bits: "
            + ", ".join(f"{step:.4g}" for step in STEPS[row.quantity][1])
            + (f" {STEPS[row.quantity][0]}" if STEPS[row.quantity][0] else ""),
        )
        for row in REGISTERS.values()
    ]


MOTEUS: Final = DriveProtocol(
    name="moteus",
    title="moteus registers over CAN FD",
    side="output",
    before=(
        "Calibrate the motor; set `id.id`, `motor_position.rotor_to_output_ratio` and "
        "`servo.timeout_mode` 0, so that it stops where commands fail to come. The watchdog's time "
        "goes with each command."
    ),
    fd=True,
    nodes=(1, 126),
    options={"source": Option(0, "address of the master", tuple(range(127)))},
    master=MoteusMaster,
    firmware=MoteusFirmware,
    registers=_registers,
    command_enables=True,
)
