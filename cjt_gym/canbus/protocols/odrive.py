"""ODrive CANSimple: the master's side, and the table of its messages.

An identifier of 11 bits is the node times 32 plus a command. Values are little-endian integers and
floats, in revolutions of the motor. What a drive sends it sends in its own cycle or when asked with
a remote frame; the heartbeat always comes. Commands are not answered, but feed the watchdog of the
drive, which may expire while the axis is idle, too: clear the errors just before enabling.

Boards of the older firmware 0.5 differ in their errors and show no temperature: option `firmware`.

References:
    ODrive Robotics, CAN Protocol, and ``odrive-cansimple.dbc`` of firmwares 0.6.10 and 0.5.6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, tau
from typing import Final

from cjt_gym.canbus.protocols.contract import (
    Message,
    Mode,
    Settings,
    Step,
    Update,
    frame_of,
    is_plain,
)
from cjt_gym.canbus.protocols.layout import Field, Layout, nothing
from cjt_gym.errors import ProtocolError

__all__ = ["MESSAGES", "OdriveMaster", "OdriveMessage", "State"]


class State:
    """Numbers of the axis states that matter here."""

    UNDEFINED: Final = 0
    IDLE: Final = 1
    STARTUP: Final = 2
    CLOSED_LOOP: Final = 8


STATES: Final = {
    0: "undefined",
    1: "idle",
    2: "startup sequence",
    3: "full calibration",
    4: "motor calibration",
    6: "encoder index search",
    7: "encoder offset calibration",
    8: "closed loop control",
    9: "lock-in spin",
    10: "encoder direction search",
    11: "homing",
}
ERRORS: Final = {
    0x1: "initializing",
    0x2: "system level",
    0x4: "timing error",
    0x8: "missing estimate",
    0x10: "bad configuration",
    0x20: "gate driver fault",
    0x40: "missing input",
    0x100: "supply voltage too high",
    0x200: "supply voltage too low",
    0x400: "too much supply current",
    0x800: "too much regenerated current",
    0x1000: "current limit violated",
    0x2000: "motor too hot",
    0x4000: "inverter too hot",
    0x8000: "velocity limit violated",
    0x10000: "position limit violated",
    0x1000000: "watchdog expired",
    0x2000000: "emergency stop requested",
    0x4000000: "spin-out detected",
    0x8000000: "brake resistor disarmed",
    0x10000000: "thermistor disconnected",
    0x40000000: "calibration error",
}
ERRORS_05: Final = {
    0x1: "invalid state",
    0x40: "motor failed",
    0x80: "sensorless estimator failed",
    0x100: "encoder failed",
    0x200: "controller failed",
    0x800: "watchdog expired",
    0x1000: "lower end switch pressed",
    0x2000: "upper end switch pressed",
    0x4000: "emergency stop requested",
    0x20000: "homing without end switch",
    0x40000: "too hot",
    0x80000: "unknown position",
}
"""Bits of the axis error in firmware 0.5."""
TORQUE_CONTROL: Final = 1
PASSTHROUGH: Final = 1
WRITE, READ = 1, 0


@dataclass(frozen=True)
class OdriveMessage:
    """A message of CANSimple.

    Attributes:
        command: Low five bits of the identifier.
        name: Its name in the maker's document.
        to_drive: Whether the master sends it.
        layout: What it holds.
        text: More to know about it.
    """

    command: int
    name: str
    to_drive: bool
    layout: Layout
    text: str = ""


def _f32(name: str, unit: str, text: str = "") -> Field:
    return Field(name, 32, "float", unit=unit, text=text)


def _message(
    command: int, name: str, to_drive: bool, *fields: Field, text: str = ""
) -> OdriveMessage:
    return OdriveMessage(command, name, to_drive, Layout(fields), text)


MESSAGES: Final = {
    row.name: row
    for row in (
        _message(
            0x01,
            "Heartbeat",
            False,
            Field("Axis_Error", 32, names=ERRORS),
            Field("Axis_State", 8, names=STATES),
            Field("Procedure_Result", 8, text="0 success, 1 busy"),
            Field("Trajectory_Done_Flag", 1),
            nothing(15),
            text="in its own cycle",
        ),
        _message(0x02, "Estop", True, text="stops with an error; not sent, but obeyed"),
        _message(
            0x03,
            "Get_Error",
            False,
            Field("Active_Errors", 32, names=ERRORS),
            Field("Disarm_Reason", 32, names=ERRORS),
        ),
        _message(
            0x04,
            "RxSdo",
            True,
            Field("Opcode", 8, text="0 reads, 1 writes"),
            Field("Endpoint_ID", 16, text="as in the firmware's list of endpoints"),
            nothing(8),
            Field("Value", 32, text="bits of the value"),
        ),
        _message(
            0x05,
            "TxSdo",
            False,
            nothing(8),
            Field("Endpoint_ID", 16),
            nothing(8),
            Field("Value", 32, text="bits of the value"),
            text="answer to reading",
        ),
        _message(
            0x07,
            "Set_Axis_State",
            True,
            Field("Axis_Requested_State", 32, names=STATES),
            nothing(32),
        ),
        _message(
            0x09,
            "Get_Encoder_Estimates",
            False,
            _f32("Pos_Estimate", "rev"),
            _f32("Vel_Estimate", "rev/s"),
        ),
        _message(
            0x0B,
            "Set_Controller_Mode",
            True,
            Field("Control_Mode", 32, text="1 for torque"),
            Field("Input_Mode", 32, text="1 for passing it through"),
        ),
        _message(
            0x0E, "Set_Input_Torque", True, _f32("Input_Torque", "N m", "of the motor"), nothing(32)
        ),
        _message(0x14, "Get_Iq", False, _f32("Iq_Setpoint", "A"), _f32("Iq_Measured", "A")),
        _message(
            0x15,
            "Get_Temperature",
            False,
            _f32("FET_Temperature", "degC"),
            _f32("Motor_Temperature", "degC"),
        ),
        _message(0x16, "Reboot", True, Field("Action", 8, text="0 reboots; not sent, but obeyed")),
        _message(
            0x17,
            "Get_Bus_Voltage_Current",
            False,
            _f32("Bus_Voltage", "V"),
            _f32("Bus_Current", "A"),
        ),
        _message(0x18, "Clear_Errors", True, Field("Identify", 8, text="1 blinks")),
        _message(
            0x1C,
            "Get_Torques",
            False,
            _f32("Torque_Target", "N m", "of the motor"),
            _f32("Torque_Estimate", "N m", "of the motor"),
        ),
    )
}
"""The messages of CANSimple that are used here, by their names."""
IN_05: Final = ("Heartbeat", "Get_Encoder_Estimates", "Get_Iq", "Get_Bus_Voltage_Current")
"""The reports that firmware 0.5 has, too; others have another meaning there."""
FAST: Final = ("Get_Encoder_Estimates", "Get_Iq")
SLOW: Final = ("Get_Temperature", "Get_Bus_Voltage_Current")
SLOW_PERIOD: Final = 0.1
"""Time between two reports of what changes slowly [s]."""


def reports_of(firmware: str) -> dict[int, OdriveMessage]:
    """Return what a drive of this firmware sends, by commands."""
    rows = (row for row in MESSAGES.values() if not row.to_drive)
    return {row.command: row for row in rows if firmware != "0.5" or row.name in IN_05}


def error_text(error: int, errors: Mapping[int, str] = ERRORS) -> str:
    """Return the bits of an error in words."""
    return ", ".join(text for bit, text in errors.items() if error & bit) or f"error {error:#x}"


class OdriveMaster:
    """Commands one axis; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._reports = reports_of(settings.options["firmware"])
        self._errors = ERRORS_05 if settings.options["firmware"] == "0.5" else ERRORS
        self._slow = [row.name for row in self._reports.values() if row.name in SLOW]
        hot = {"temperature"} if "Get_Temperature" in self._slow else set()
        self.channels = frozenset({"q_m", "dq_m", "i", "v_bus"} | hot)
        self.torque_range = (-inf, inf)
        ask = settings.options["reports"] == "ask"
        fast = settings.period if ask else settings.options["cycle_ms"] * 1e-3
        slow = dict.fromkeys({"v_bus"} | hot, SLOW_PERIOD)
        self.periods = dict.fromkeys(self.channels, fast) | slow
        self._ask = ask
        self._every = max(1, round(SLOW_PERIOD / settings.period))
        self._count = 0

    def configure(self) -> Sequence[Step]:
        """Return the steps that wait for a heartbeat and set the watchdog where they can."""
        steps = [Step("Wait for a heartbeat", (), self._alive, timeout=2.0)]
        options, watchdog = self.settings.options, self.settings.watchdog
        time = MESSAGES["Set_Input_Torque"].layout.fields[0].to_bits(watchdog)
        for what, endpoint, value in (
            ("time", options["watchdog_timeout_endpoint"], time),
            ("switch", options["enable_watchdog_endpoint"], 1),
        ):
            if endpoint:
                steps.append(self._sdo(f"Set the watchdog's {what}", endpoint, value))
        return steps

    def clear(self) -> Sequence[Step]:
        """Return the one step."""
        return [
            Step(
                "Clear the errors",
                [self._frame("Clear_Errors", Identify=0)],
                lambda frame: self._beat(frame, lambda error, state: not error),
                meanwhile=[self._frame("Set_Input_Torque"), self._request("Heartbeat")],
            )
        ]

    def enable(self) -> Sequence[Step]:
        """Return the steps to closed loop control of the torque."""
        zero = self._frame("Set_Input_Torque")
        mode = {"Control_Mode": TORQUE_CONTROL, "Input_Mode": PASSTHROUGH}
        return [
            Step("Torque control, zero torque", [self._frame("Set_Controller_Mode", **mode), zero]),
            Step(
                "Closed loop control",
                [self._frame("Set_Axis_State", Axis_Requested_State=State.CLOSED_LOOP)],
                lambda frame: self._beat(frame, self._running),
                timeout=1.0,
                meanwhile=[zero, self._request("Heartbeat")],
            ),
        ]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the torque, and what asks for reports where the drive does not send by itself."""
        torque = self.settings.scaling.drive_torque(tau_m)
        return [self._frame("Set_Input_Torque", Input_Torque=torque), *self.poll()]

    def commanded(self, frame: Message) -> float | None:
        """Return the torque of `Set_Input_Torque`."""
        if not is_plain(frame, self._id("Set_Input_Torque")):
            return None
        values = MESSAGES["Set_Input_Torque"].layout.decode(frame.data)
        return self.settings.scaling.torque(values["Input_Torque"])

    def poll(self) -> Sequence[Message]:
        """Return the remote frames that ask for reports; none where it sends by itself."""
        if not self._ask:
            return []
        slow = self._slow if self._count % self._every == 0 else ()
        self._count += 1
        return [self._request(name) for name in (*FAST, *slow)]

    def disable(self) -> Sequence[Message]:
        """Return zero torque and the request for idle."""
        return [
            self._frame("Set_Input_Torque"),
            self._frame("Set_Axis_State", Axis_Requested_State=State.IDLE),
        ]

    def decode(self, frame: Message) -> Update | None:
        """Return what a message of this axis says."""
        if frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame:
            return None
        node, command = divmod(frame.arbitration_id, 32)
        row = self._reports.get(command)
        if node != self.settings.node or row is None:
            return None
        values = row.layout.decode(frame.data)
        if row.name == "Heartbeat":
            return self._heartbeat(int(values["Axis_Error"]), int(values["Axis_State"]))
        if row.name == "Get_Error":
            error = int(values["Active_Errors"]) | int(values["Disarm_Reason"])
            return Update(error=error, text=error_text(error, self._errors) if error else "")
        return Update(self._channels(row.name, values))

    def _heartbeat(self, error: int, state: int) -> Update:
        if error:
            return Update(mode=Mode.FAULT, error=error, text=error_text(error, self._errors))
        if state == State.CLOSED_LOOP:
            return Update(mode=Mode.ENABLED, error=0)
        booting = state in (State.UNDEFINED, State.STARTUP)
        return Update(mode=Mode.BOOTING if booting else Mode.DISABLED, error=0)

    def _channels(self, name: str, values: Mapping[str, float]) -> Mapping[str, float]:
        scaling = self.settings.scaling
        match name:
            case "Get_Encoder_Estimates":
                return {
                    "q_m": scaling.angle(values["Pos_Estimate"] * tau),
                    "dq_m": scaling.rate(values["Vel_Estimate"] * tau),
                }
            case "Get_Iq":
                return {"i": scaling.sign * values["Iq_Measured"]}
            case "Get_Temperature":
                return {"temperature": max(values["FET_Temperature"], values["Motor_Temperature"])}
            case "Get_Bus_Voltage_Current":
                return {"v_bus": values["Bus_Voltage"]}
            case _:
                return {}

    def _running(self, error: int, state: int) -> bool:
        if error:
            raise ProtocolError(
                f"ODrive {self.settings.node} refuses closed loop control: "
                f"{error_text(error, self._errors)}."
            )
        return state == State.CLOSED_LOOP

    def _beat(self, frame: Message, wanted: Callable[[int, int], bool]) -> bool:
        if frame.is_remote_frame or frame.arbitration_id != self._id("Heartbeat"):
            return False
        values = MESSAGES["Heartbeat"].layout.decode(frame.data)
        return wanted(int(values["Axis_Error"]), int(values["Axis_State"]))

    def _alive(self, frame: Message) -> bool:
        return self._beat(frame, lambda error, state: state != State.UNDEFINED)

    def _sdo(self, text: str, endpoint: int, value: int) -> Step:
        address = {"Endpoint_ID": endpoint}

        def confirmed(frame: Message) -> bool:
            if frame.arbitration_id != self._id("TxSdo") or frame.is_remote_frame:
                return False
            read = MESSAGES["TxSdo"].layout.decode(bytes(frame.data).ljust(8, b"\0"))
            return read == {**address, "Value": value}

        return Step(
            text,
            [
                self._frame("RxSdo", Opcode=WRITE, Value=value, **address),
                self._frame("RxSdo", Opcode=READ, **address),
            ],
            confirmed,
        )

    def _id(self, name: str) -> int:
        return self.settings.node << 5 | MESSAGES[name].command

    def _frame(self, name: str, **values: float) -> Message:
        return frame_of(self._id(name), MESSAGES[name].layout.encode(values))

    def _request(self, name: str) -> Message:
        return frame_of(self._id(name), remote=True)
