"""ODrive CANSimple: table of messages.

References:
    ODrive Robotics, CAN Protocol, and ``odrive-cansimple.dbc`` of firmwares 0.6.10 and 0.5.6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cjt_gym.canbus.protocols.layout import Field, Layout, nothing


class State:
    """Numbers of the axis states used here."""

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
VERSION: Final = (
    "Protocol_Version",
    *("Hw_Version_Major", "Hw_Version_Minor", "Hw_Version_Variant"),
    *("Fw_Version_Major", "Fw_Version_Minor", "Fw_Version_Revision", "Fw_Version_Unreleased"),
)
EMULATED: Final = (2, 0, 0, 0, 0, 0, 0, 0)
"""What an emulated drive says of itself; no drive that is sold has this hardware."""
ENDPOINTS: Final[Mapping[tuple[int, ...], tuple[int, int]]] = {EMULATED: (190, 191)}
"""Endpoints of the watchdog's time and switch, by the version that a drive says it has.

They differ from firmware to firmware; writing to a wrong one changes something else. So they are
only taken from here where hardware and firmware are the very ones.
"""
TORQUE_CONTROL: Final = 1
PASSTHROUGH: Final = 1
WRITE, READ = 1, 0


@dataclass(frozen=True)
class OdriveMessage:
    """A message of CANSimple; its command is the low five bits of the identifier."""

    command: int
    name: str
    to_drive: bool
    layout: Layout
    text: str = ""


def _f32(name: str, unit: str, text: str = "") -> Field:
    return Field(name, 32, "float", unit=unit, text=text)


def _report(command: int, name: str, *fields: Field, text: str = "") -> OdriveMessage:
    return OdriveMessage(command, name, False, Layout(fields), text)


def _order(command: int, name: str, *fields: Field, text: str = "") -> OdriveMessage:
    return OdriveMessage(command, name, True, Layout(fields), text)


MESSAGES: Final = {
    row.name: row
    for row in (
        _report(
            0x00,
            "Get_Version",
            *(Field(name, 8) for name in VERSION),
            text="says which endpoints it has",
        ),
        _report(
            0x01,
            "Heartbeat",
            Field("Axis_Error", 32, names=ERRORS),
            Field("Axis_State", 8, names=STATES),
            Field("Procedure_Result", 8, text="0 success, 1 busy"),
            Field("Trajectory_Done_Flag", 1),
            nothing(15),
            text="in its own cycle",
        ),
        _order(0x02, "Estop", text="stops with an error; not sent, but obeyed"),
        _report(
            0x03,
            "Get_Error",
            Field("Active_Errors", 32, names=ERRORS),
            Field("Disarm_Reason", 32, names=ERRORS),
        ),
        _order(
            0x04,
            "RxSdo",
            Field("Opcode", 8, text="0 reads, 1 writes"),
            Field("Endpoint_ID", 16, text="as in the firmware's list of endpoints"),
            nothing(8),
            Field("Value", 32, text="bits of the value"),
        ),
        _report(
            0x05,
            "TxSdo",
            nothing(8),
            Field("Endpoint_ID", 16),
            nothing(8),
            Field("Value", 32, text="bits of the value"),
            text="answer to reading",
        ),
        _order(
            0x07, "Set_Axis_State", Field("Axis_Requested_State", 32, names=STATES), nothing(32)
        ),
        _report(
            0x09,
            "Get_Encoder_Estimates",
            _f32("Pos_Estimate", "rev"),
            _f32("Vel_Estimate", "rev/s"),
        ),
        _order(
            0x0B,
            "Set_Controller_Mode",
            Field("Control_Mode", 32, text="1 for torque"),
            Field("Input_Mode", 32, text="1 for passing it through"),
        ),
        _order(0x0E, "Set_Input_Torque", _f32("Input_Torque", "N m", "of the motor"), nothing(32)),
        _report(0x14, "Get_Iq", _f32("Iq_Setpoint", "A"), _f32("Iq_Measured", "A")),
        _report(
            0x15,
            "Get_Temperature",
            _f32("FET_Temperature", "degC"),
            _f32("Motor_Temperature", "degC"),
        ),
        _order(0x16, "Reboot", Field("Action", 8, text="0 reboots; not sent, but obeyed")),
        _report(
            0x17, "Get_Bus_Voltage_Current", _f32("Bus_Voltage", "V"), _f32("Bus_Current", "A")
        ),
        _order(0x18, "Clear_Errors", Field("Identify", 8, text="1 blinks")),
        _report(
            0x1C,
            "Get_Torques",
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
    """Return the messages that a drive of this firmware sends, by command."""
    rows = (row for row in MESSAGES.values() if not row.to_drive)
    return {row.command: row for row in rows if firmware != "0.5" or row.name in IN_05}


def error_text(error: int, errors: Mapping[int, str] = ERRORS) -> str:
    """Return an error in words."""
    return ", ".join(text for bit, text in errors.items() if error & bit) or f"error {error:#x}"
