"""ODrive CANSimple: the master's side.

The 11-bit identifier is 32 times the node plus the command. Values are little-endian integers and
floats, in revolutions of the motor. A drive sends messages periodically or on request by a remote
frame; it always sends the heartbeat. It does not answer commands, but they feed its watchdog. The
watchdog can also expire while the axis is idle, so errors are cleared just before enabling.

Drives are shipped with the watchdog off. It is switched on over CAN if its endpoints are known,
otherwise with the manufacturer's tool; either way it is tested before the joint is armed.

Boards with the older firmware 0.5 have other error codes and report no temperature: see the option
`firmware`.

References:
    ODrive Robotics, CAN Protocol, and ``odrive-cansimple.dbc`` of firmwares 0.6.10 and 0.5.6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import tau

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
from cjt_gym.canbus.protocols.odrive_messages import (
    ENDPOINTS,
    ERRORS,
    ERRORS_05,
    FAST,
    MESSAGES,
    PASSTHROUGH,
    READ,
    SLOW,
    SLOW_PERIOD,
    TORQUE_CONTROL,
    VERSION,
    WRITE,
    State,
    error_text,
    reports_of,
)
from cjt_gym.errors import ProtocolError


class OdriveMaster(Master):
    """Commands one axis; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        options = settings.options
        self._reports = reports_of(options["firmware"])
        self._errors = ERRORS_05 if options["firmware"] == "0.5" else ERRORS
        self._slow = [row.name for row in self._reports.values() if row.name in SLOW]
        self._ask = options["reports"] == "ask"
        fast = settings.period if self._ask else options["cycle_ms"] * 1e-3
        slow = ("v_bus", "temperature") if "Get_Temperature" in self._slow else ("v_bus",)
        periods = dict.fromkeys(("q_m", "dq_m", "i"), fast) | dict.fromkeys(slow, SLOW_PERIOD)
        super().__init__(settings, periods)
        self._every = max(1, round(SLOW_PERIOD / settings.period))
        self._count = 0
        self._endpoints: tuple[int, int] = (
            options["watchdog_timeout_endpoint"],
            options["enable_watchdog_endpoint"],
        )

    def configure(self) -> Iterator[Step]:
        """Yield the steps that wait for a heartbeat and set the watchdog if possible."""
        yield Step("Wait for a heartbeat", (), self._alive, timeout=2.0)
        if not any(self._endpoints) and self.settings.options["firmware"] != "0.5":
            ask = [self._request("Get_Version")]
            yield Step("Ask for its version", ask, self._find_endpoints, 0.1, optional=True)
        time = MESSAGES["Set_Input_Torque"].layout.fields[0].to_bits(self.settings.watchdog)
        for what, endpoint, value in zip(
            ("time", "switch"), self._endpoints, (time, 1), strict=True
        ):
            if endpoint:
                yield self._sdo(f"Set the watchdog's {what}", endpoint, value)

    def clear(self) -> Sequence[Step]:
        """Return the step that clears errors."""
        return [
            Step(
                "Clear the errors",
                [self._frame("Clear_Errors", Identify=0)],
                lambda frame: self._beat(frame, lambda error, state: not error),
                meanwhile=[self._frame("Set_Input_Torque"), self._request("Heartbeat")],
            )
        ]

    def enable(self) -> Sequence[Step]:
        """Return the steps to closed-loop torque control."""
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
        """Return the torque command, and requests for reports that are not periodic."""
        torque = self.settings.scaling.drive_torque(tau_m)
        return [self._frame("Set_Input_Torque", Input_Torque=torque), *self.poll()]

    def commanded(self, frame: Message) -> float | None:
        """Return the torque of `Set_Input_Torque`."""
        if not is_plain(frame, self._id("Set_Input_Torque")):
            return None
        values = MESSAGES["Set_Input_Torque"].layout.decode(frame.data)
        return self.settings.scaling.torque(values["Input_Torque"])

    def poll(self) -> Sequence[Message]:
        """Return the remote frames that request reports; none if the drive sends periodically."""
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
        """Decode a message of this axis."""
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

    def _find_endpoints(self, frame: Message) -> bool:
        """Take the watchdog's endpoints from the version in a frame; return whether it has one."""
        if frame.arbitration_id != self._id("Get_Version") or frame.is_remote_frame:
            return False
        values = MESSAGES["Get_Version"].layout.decode(frame.data)
        self._endpoints = ENDPOINTS.get(tuple(int(values[name]) for name in VERSION), (0, 0))
        return True

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
