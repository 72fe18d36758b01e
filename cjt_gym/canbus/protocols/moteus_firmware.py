"""moteus: the drive's side, and the row of the table of protocols."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from math import isnan, nan, tau
from typing import Final

from cjt_gym.canbus.protocols.contract import Fault, Message, Mode, Settings, frame_of
from cjt_gym.canbus.protocols.firmware import Firmware
from cjt_gym.canbus.protocols.moteus import (
    ANSWER,
    FAULTED,
    POSITION,
    STOPPED,
    TIMEOUT,
    MoteusMaster,
    is_extended,
)
from cjt_gym.canbus.protocols.moteus_registers import (
    ASK,
    FLOAT,
    INT8,
    LARGEST,
    MOST,
    READ_ERROR,
    REGISTERS,
    REPLY,
    STEPS,
    Replies,
    Subframe,
    field_of,
    pad,
    read,
    said,
    subframe,
)
from cjt_gym.canbus.protocols.row import DriveProtocol, Option, Register
from cjt_gym.errors import ProtocolError

BROADCAST: Final = 0x7F
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
DEFAULT_TIMEOUT: Final = 0.1
"""`servo.default_timeout_s` as a drive leaves the factory [s]."""
KP, KD = 4.0, 0.05
"""Position gains of an emulated drive [N m/rev, N m/(rev/s)]: the firmware's `pid_position`."""


class MoteusFirmware(Firmware):
    """Behaves as a drive; see :class:`~cjt_gym.canbus.protocols.contract.Firmware`."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._told: dict[int, float] = {}
        self._held = 0.0
        self._stored = settings.limits.watchdog or DEFAULT_TIMEOUT

    def boot(self, now: float) -> Sequence[Message]:
        """Start silently."""
        self._power_up()
        self._told = {}
        return []

    def heeds(self, frame: Message) -> bool:
        """Return whether a frame may be for this drive."""
        if frame.is_error_frame or frame.is_remote_frame or frame.arbitration_id > 0xFFFF:
            return False
        return frame.arbitration_id & 0xFF in (self.settings.node, BROADCAST)

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a frame for this drive, and answer if it asks for that."""
        if not self.heeds(frame):
            return []
        try:
            found = read(frame.data)
        except ProtocolError:
            return []
        self._write(said(found, "write"), now)
        asked = [each for each in found if each.kind == "ask"]
        if not asked or not frame.arbitration_id & ANSWER:
            return []
        identifier = self.settings.node << 8 | frame.arbitration_id >> 8 & 0x7F
        replies = _replies(tuple(asked))
        data = replies.data(self._shown) if replies else b"".join(map(self._answer, asked))
        if len(data) > MOST:
            return []
        return [frame_of(identifier, pad(data), extended=is_extended(identifier), fd=True)]

    def _write(self, written: dict[int, float], now: float) -> None:
        mode = written.get(0x000)
        if mode == STOPPED:
            self._disable()
            self._clear()
        elif mode == POSITION and self._enable(now):
            self._told = written
            self._held = self._seen(0x001)
            time = written.get(0x027, 0.0)
            self.watchdog = 0.0 if isnan(time) else time or self._stored
            self._feed(now)
            self._act()

    def _act(self) -> None:
        """Set the torque of position mode, without an integral term."""
        told = self._told
        if not told:
            return
        torque = told.get(0x022, 0.0)
        if stiffness := KP * told.get(0x023, 1.0):
            position = told.get(0x020, 0.0)
            aim = self._held if isnan(position) else position
            torque += stiffness * (aim - self._seen(0x001))
        if damping := KD * told.get(0x024, 1.0):
            torque += damping * (told.get(0x021, 0.0) - self._seen(0x002))
        most = told.get(0x025, nan)
        torque = torque if isnan(most) else min(max(torque, -most), most)
        self._ask(self.settings.scaling.torque(torque))

    def _answer(self, asked: Subframe) -> bytes:
        if all(number in REGISTERS for number in asked.numbers):
            values = [self._shown(number, asked.type) for number in asked.numbers]
            return subframe(REPLY, asked.type, asked.numbers[0], values) if values else b""
        if len(asked.numbers) == 1:
            return bytes([READ_ERROR, *subframe(ASK, INT8, asked.numbers[0], 1)[1:], 1])
        each = (asked._replace(numbers=asked.numbers[k : k + 1]) for k in range(len(asked.numbers)))
        return b"".join(map(self._answer, each))

    def _shown(self, number: int, kind: int) -> float:
        value = self._seen(number)
        value = value if abs(value) < LARGEST else nan
        if kind == FLOAT:
            return value
        low, high, step = _limits(number, kind)
        return min(max(value, low + step), high)

    def _seen(self, number: int) -> float:
        scaling, channels = self.settings.scaling, self._channels
        match number:
            case 0x000:
                return self._shown_mode()
            case 0x001 | 0x006:
                return self._shaft()[0] / tau
            case 0x002:
                return self._shaft()[1] / tau
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


@lru_cache(maxsize=64)
def _replies(asked: Sequence[Subframe]) -> Replies | None:
    """Return the layout of a reply that needs no further thought."""
    known = all(each.numbers and REGISTERS.keys() >= {*each.numbers} for each in asked)
    try:
        return Replies(asked) if known else None
    except ProtocolError:  # too long
        return None


@cache
def _limits(number: int, kind: int) -> tuple[float, float, float]:
    """Return the lowest and highest value of a register as an integer, and its step."""
    field = field_of(number, kind)
    return *field.range, field.scale


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
    options={"source": Option(0, "address of the master", range(127))},
    master=MoteusMaster,
    firmware=MoteusFirmware,
    registers=_registers,
    command_enables=True,
)
