"""ODrive CANSimple: the drive's side, and the row of the table of protocols."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import tau
from typing import Any, Final

from cjt_gym.canbus.protocols.contract import Fault, Message, Mode, Settings, frame_of
from cjt_gym.canbus.protocols.firmware import Cycles, Firmware
from cjt_gym.canbus.protocols.odrive import OdriveMaster
from cjt_gym.canbus.protocols.odrive_messages import (
    EMULATED,
    ENDPOINTS,
    FAST,
    MESSAGES,
    PASSTHROUGH,
    SLOW,
    SLOW_PERIOD,
    TORQUE_CONTROL,
    VERSION,
    WRITE,
    State,
    reports_of,
)
from cjt_gym.canbus.protocols.row import DriveProtocol, Option, Register
from cjt_gym.errors import ConfigurationError, ProtocolError

HEARTBEAT_PERIOD: Final = 0.1  # as set in the factory [s]
CODES: Final = {
    Fault.WATCHDOG: 0x1000000,
    Fault.OVER_TEMPERATURE: 0x2000,
    Fault.OVER_CURRENT: 0x1000,
    Fault.OVER_VOLTAGE: 0x100,
    Fault.UNDER_VOLTAGE: 0x200,
    Fault.OVER_SPEED: 0x8000,
    Fault.ENCODER: 0x8,
    Fault.STOPPED: 0x2000000,
    Fault.OTHER: 0x2,
}
CODES_05: Final = {
    Fault.WATCHDOG: 0x800,
    Fault.OVER_TEMPERATURE: 0x40000,
    Fault.OVER_CURRENT: 0x40,
    Fault.OVER_VOLTAGE: 0x40,
    Fault.UNDER_VOLTAGE: 0x40,
    Fault.OVER_SPEED: 0x200,
    Fault.ENCODER: 0x100,
    Fault.STOPPED: 0x4000,
    Fault.OTHER: 0x1,
}
COMMANDS: Final = {row.command: row for row in MESSAGES.values() if row.to_drive}


class OdriveFirmware(Firmware):
    """Behaves as an axis; see :class:`~cjt_gym.canbus.protocols.contract.Firmware`."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.in_torque_mode = False
        options = settings.options
        self._codes = CODES_05 if options["firmware"] == "0.5" else CODES
        self._known = reports_of(options["firmware"]) | COMMANDS
        given = (options["watchdog_timeout_endpoint"], options["enable_watchdog_endpoint"])
        known = given if any(given) else ENDPOINTS[EMULATED]
        self._endpoints = dict(zip(known, ("time", "switch"), strict=True))
        self._time, self._is_watched = settings.limits.watchdog, settings.limits.watchdog > 0.0
        periods = {"Heartbeat": HEARTBEAT_PERIOD}
        if options["reports"] == "cyclic":
            periods |= dict.fromkeys(FAST, options["cycle_ms"] * 1e-3)
            names = {row.name for row in self._known.values()}
            periods |= {name: SLOW_PERIOD for name in SLOW if name in names}
        self._cycles = Cycles(periods)

    def boot(self, now: float) -> Sequence[Message]:
        """Start with a heartbeat."""
        self._power_up()
        self.in_torque_mode = False
        self._cycles.begin(now)
        return [self._report("Heartbeat")]

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a message for this axis, and answer requests."""
        node, command = divmod(frame.arbitration_id, 32)
        row = self._known.get(command)
        if frame.is_extended_id or frame.is_error_frame or row is None:
            return []
        if node != self.settings.node:
            return []
        if frame.is_remote_frame or not row.to_drive:
            asked = not row.to_drive and row.name != "TxSdo" and not frame.data
            return [self._report(row.name)] if asked else []
        try:
            values = row.layout.decode(frame.data)
        except ProtocolError:
            return []
        return self._obey(row.name, values, now)

    def _due(self, now: float) -> Sequence[Message]:
        return [self._report(name) for name in self._cycles.due(now)]

    def _obey(self, name: str, values: Mapping[str, float], now: float) -> Sequence[Message]:
        match name:
            case "Set_Input_Torque":
                self._feed(now)
                self._ask(self.settings.scaling.torque(values["Input_Torque"]))
            case "Set_Axis_State":
                self._go(int(values["Axis_Requested_State"]), now)
            case "Set_Controller_Mode":
                wanted = (TORQUE_CONTROL, PASSTHROUGH)
                mode = (values["Control_Mode"], values["Input_Mode"])
                self.in_torque_mode = mode == wanted
            case "Clear_Errors":
                self._clear()
            case "Estop":
                self.fail(Fault.STOPPED)
            case "Reboot" if values["Action"] == 0:
                return self.boot(now)
            case "RxSdo":
                return self._sdo(values)
        return []

    def _go(self, state: int, now: float) -> None:
        if state == State.CLOSED_LOOP:
            self._enable(now)
        elif state == State.IDLE:
            self._disable()

    def _sdo(self, values: Mapping[str, float]) -> Sequence[Message]:
        endpoint = int(values["Endpoint_ID"])
        what = self._endpoints.get(endpoint) if endpoint else None
        number = MESSAGES["Set_Input_Torque"].layout.fields[0]
        if what is None:
            return []
        if values["Opcode"] == WRITE:
            if what == "time":
                self._time = number.from_bits(int(values["Value"]))
            else:
                self._is_watched = bool(values["Value"])
            self.watchdog = self._time if self._is_watched else 0.0
            return []
        value = number.to_bits(self._time) if what == "time" else int(self._is_watched)
        return [self._frame("TxSdo", Endpoint_ID=endpoint, Value=value)]

    def _report(self, name: str) -> Message:
        scaling, channels = self.settings.scaling, self._channels
        code = self._codes[self.fault] if self.fault else 0
        match name:
            case "Heartbeat":
                on = self.mode is Mode.ENABLED
                state = State.CLOSED_LOOP if on else State.IDLE
                return self._frame(name, Axis_Error=code, Axis_State=state)
            case "Get_Version":
                return self._frame(name, **dict(zip(VERSION, EMULATED, strict=True)))
            case "Get_Error":
                return self._frame(name, Active_Errors=code, Disarm_Reason=code)
            case "Get_Encoder_Estimates":
                angle, rate = self._shaft()
                return self._frame(name, Pos_Estimate=angle / tau, Vel_Estimate=rate / tau)
            case "Get_Iq":
                current = scaling.sign * channels.get("i", 0.0)
                return self._frame(name, Iq_Setpoint=current, Iq_Measured=current)
            case "Get_Temperature":
                hot = channels.get("temperature", 25.0)
                return self._frame(name, FET_Temperature=hot, Motor_Temperature=hot)
            case "Get_Torques":
                told = scaling.drive_torque(self.torque)
                made = scaling.drive_torque(channels.get("tau_m", self.torque))
                return self._frame(name, Torque_Target=told, Torque_Estimate=made)
            case _:
                return self._frame(name, Bus_Voltage=channels.get("v_bus", 0.0))

    def _frame(self, name: str, **values: float) -> Message:
        row = MESSAGES[name]
        return frame_of(self.settings.node << 5 | row.command, row.layout.encode(values))


def _check(options: Mapping[str, Any]) -> None:
    endpoints = options["watchdog_timeout_endpoint"] or options["enable_watchdog_endpoint"]
    if options["firmware"] == "0.5" and endpoints:
        raise ConfigurationError(
            "Endpoints must be 0 with firmware 0.5, which does not have them on CAN. Set the "
            "watchdog with odrivetool."
        )


def _registers() -> Sequence[Register]:
    return [
        Register(
            f"{row.command:#04x}",
            "to drive" if row.to_drive else "from drive",
            row.name,
            row.layout.fields,
            row.text,
        )
        for row in MESSAGES.values()
    ]


ODRIVE: Final = DriveProtocol(
    name="odrive",
    title="ODrive CANSimple",
    side="motor",
    before=(
        "Calibrate the motor; set `can.node_id` and the baud rate; set `config.enable_watchdog`, "
        "which is off by default, and `config.watchdog_timeout`, or give their endpoints "
        'below so that both are set and read back over CAN. With `reports = "cyclic"` '
        "set the cycles of encoder and current to `cycle_ms`, and those of temperature and supply "
        "to 100 ms. Angles and torques refer to the motor's shaft; the torque constant is the one "
        "that is set in the drive."
    ),
    nodes=(0, 62),
    options={
        "firmware": Option("0.6", "of the drive", ("0.6", "0.5")),
        "reports": Option(
            "ask", "asked for in every period, or sent by the drive in its cycle", ("ask", "cyclic")
        ),
        "cycle_ms": Option(10, "cycle of encoder and current, as set in the drive [ms]"),
        "watchdog_timeout_endpoint": Option(
            0, "endpoint of axis0.config.watchdog_timeout in this firmware; 0: not set from here"
        ),
        "enable_watchdog_endpoint": Option(
            0, "endpoint of axis0.config.enable_watchdog in this firmware; 0: not set from here"
        ),
    },
    check=_check,
    master=OdriveMaster,
    firmware=OdriveFirmware,
    registers=_registers,
)
