"""CiA 402 over CANopen, cyclic synchronous torque: the drive's side, and the row of the table.

Object dictionary, SDO, NMT and heartbeat are those of the `canopen` library's node, connected to a
list of frames instead of a bus.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import tau
from typing import Any, Final, cast

from can import Message
from canopen import LocalNode, Network
from canopen.sdo.exceptions import SdoAbortedError

from cjt_gym.canbus.protocols.cia402 import HEARTBEAT, RPDO, SYNC, TPDOS, Cia402Master
from cjt_gym.canbus.protocols.cia402_objects import (
    CST,
    OBJECTS,
    PDOS,
    Pdo,
    State,
    object_dictionary,
)
from cjt_gym.canbus.protocols.contract import Fault, Mode, Settings, frame_of
from cjt_gym.canbus.protocols.firmware import Firmware
from cjt_gym.canbus.protocols.outbox import Outbox
from cjt_gym.canbus.protocols.row import DriveProtocol, Option, Register
from cjt_gym.errors import check_range

# Log messages about damaged requests go to handlers, not to the terminal.
logging.getLogger("canopen").addHandler(logging.NullHandler())

CODES: Final = {
    Fault.WATCHDOG: 0x8130,
    Fault.OVER_TEMPERATURE: 0x4310,
    Fault.OVER_CURRENT: 0x2310,
    Fault.OVER_VOLTAGE: 0x3210,
    Fault.UNDER_VOLTAGE: 0x3220,
    Fault.OVER_SPEED: 0x8400,
    Fault.ENCODER: 0x7305,
    Fault.STOPPED: 0x9000,
    Fault.OTHER: 0x1000,
}
VOLTAGE_AND_REMOTE: Final = 0x210


@dataclass(frozen=True)
class _Setting:
    """The configuration of a PDO: bit 31 of the identifier switches it off; its timer is in s."""

    identifier: int
    kind: int
    time: float
    objects: Sequence[tuple[int, int, int]]


class Cia402Firmware(Firmware):
    """Behaves as a drive; see :class:`~cjt_gym.canbus.protocols.contract.Firmware`."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self.watchdog = 0.0
        self._outbox = Outbox()
        self._start()

    def _start(self) -> None:
        self._network = Network(cast(Any, self._outbox))
        node = self.settings.node
        self._node = cast(Any, LocalNode(node, object_dictionary(node)))
        self._node.add_read_callback(self._show)
        self._node.add_write_callback(self._told)
        self._network.add_node(self._node)
        self._outbox.cycles.clear()
        self._state = State.SWITCH_ON_DISABLED
        self._word = 0
        self._syncs = 0
        self._timers: dict[str, float] = {}
        self._reported: Fault | None = None
        self._operation = 0
        self.in_torque_mode = False
        self._watched = 0
        self._set: dict[str, _Setting] = {}

    def boot(self, now: float) -> Sequence[Message]:
        """Start in pre-operational, with the boot-up message."""
        self._outbox.now = now
        self._start()
        self._power_up()
        self.watchdog = 0.0
        self._node.nmt.state = "INITIALISING"
        self._node.nmt.state = "PRE-OPERATIONAL"
        return self._outbox.take()

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a frame: NMT, SYNC, RPDO, SDO or a heartbeat."""
        if frame.is_extended_id or frame.is_error_frame or frame.is_remote_frame:
            return []
        self._outbox.now = now
        identifier, data = frame.arbitration_id, frame.data
        if identifier == SYNC and not data:
            self._sync()
        elif identifier == 0x000 and len(data) >= 2:
            self._network.notify(identifier, data, now)
            if self._node.nmt.state == "INITIALISING":
                return self.boot(now)
            if not self._operational and self.mode is Mode.ENABLED:
                self.fail(Fault.WATCHDOG)
        elif identifier == 0x600 + self.settings.node and len(data) == 8:
            self._network.notify(identifier, data, now)
        elif identifier == HEARTBEAT + self._watched:
            self._feed(now)
        elif self._operational:
            self._take(identifier, data)
        return self._outbox.take()

    def _due(self, now: float) -> Sequence[Message]:
        """Return the heartbeats, timed PDOs and emergencies due."""
        self._outbox.now = now
        if self.fault is not self._reported:
            self._reported = self.fault
            if self.fault:
                self._node.emcy.send(CODES[self.fault], 1)
            else:
                self._node.emcy.reset()
        for pdo in TPDOS:
            self._send_timed(pdo, now)
        return self._outbox.take()

    @property
    def _operational(self) -> bool:
        return bool(self._node.nmt.state == "OPERATIONAL")

    def _value(self, index: int, sub: int = 0) -> int:
        value: int = self._node.sdo.od.get_variable(index, sub).decode_raw(
            self._node.get_data(index, sub)
        )
        return value

    def _show(self, index: int, subindex: int, od: Any) -> int | None:
        """Return the value of an object that the drive determines, or None."""
        options: Mapping[str, Any] = self.settings.options
        channels, scaling = self._channels, self.settings.scaling
        stored = self._node.data_store.get(index, {}).get(subindex)
        match index, subindex:
            case 0x1001, 0:
                return 1 if self.fault else 0
            case 0x603F, 0:
                return CODES[self.fault] if self.fault else 0
            case 0x6041, 0:
                return self._statusword()
            case 0x6061, 0:
                return self._operation
            case 0x6064, 0:
                return _limited(self._shaft()[0] / tau * options["increments"], 32)
            case 0x606C, 0:
                units = options["velocity_units"] or options["increments"]
                return _limited(self._shaft()[1] / tau * units, 32)
            case 0x6075, 0 if stored is None:
                return int(1e3 * options["rated_current"] + 0.5)
            case 0x6076, 0 if stored is None:
                return int(1e3 * options["rated_torque"] + 0.5)
            case 0x6077, 0:
                torque = scaling.drive_torque(channels.get("tau_m", self.torque))
                return _limited(torque / options["rated_torque"] * 1e3, 16)
            case 0x6078, 0:
                current = scaling.sign * channels.get("i", 0.0)
                return _limited(current / options["rated_current"] * 1e3, 16)
            case 0x6079, 0:
                return max(0, _limited(channels.get("v_bus", 0.0) * 1e3, 32))
            case 0x608F, 1 if stored is None:
                return int(options["increments"])
            case _:
                return None

    def _told(self, index: int, subindex: int, od: Any, data: bytes) -> None:
        value = od.decode_raw(data)
        if (index, subindex) == (0x6040, 0):
            self._control(value)
        elif (index, subindex) == (0x6071, 0):
            rated = self.settings.options["rated_torque"]
            self._ask(self.settings.scaling.torque(value * rated / 1e3))
        elif (index, subindex) == (0x6060, 0):
            self._operation = value
            self.in_torque_mode = value == CST
        elif (index, subindex) == (0x1016, 1):
            self._watched, self.watchdog = value >> 16 & 0x7F, (value & 0xFFFF) / 1e3
        elif 0x1400 <= index < 0x1C00:
            self._set.clear()

    def _control(self, word: int) -> None:
        """Step the profile's state machine."""
        rising, self._word = word & ~self._word, word
        if self.mode is Mode.FAULT:
            if rising & 0x80:
                self._clear()
                self._state = State.SWITCH_ON_DISABLED
            return
        low = word & 0x0F
        if not low & 0x02 or low & 0x06 == 0x02:
            self._rest(State.SWITCH_ON_DISABLED)
        elif low & 0x07 == 0x06:
            self._rest(State.READY)
        elif low == 0x07 and self._state != State.SWITCH_ON_DISABLED:
            self._rest(State.SWITCHED_ON)
        elif low == 0x0F and self._state in (State.READY, State.SWITCHED_ON):
            self._state = State.SWITCHED_ON
            if self._operational:
                self._enable(self._outbox.now)

    def _rest(self, state: int) -> None:
        self._disable()
        self._state = state

    def _statusword(self) -> int:
        state = {Mode.ENABLED: State.ENABLED, Mode.FAULT: State.FAULT}.get(self.mode, self._state)
        return state | VOLTAGE_AND_REMOTE

    def _setting(self, pdo: Pdo) -> _Setting:
        """Return the present configuration of a PDO."""
        if pdo.name not in self._set:
            entries = [
                self._value(pdo.mapping, at)
                for at in range(1, min(self._value(pdo.mapping), 4) + 1)
            ]
            self._set[pdo.name] = _Setting(
                identifier=self._value(pdo.parameters, 1),
                kind=self._value(pdo.parameters, 2),
                time=self._value(pdo.parameters, 5) / 1e3,
                objects=[(each >> 16, each >> 8 & 0xFF, (each & 0xFF) // 8) for each in entries],
            )
        return self._set[pdo.name]

    def _sync(self) -> None:
        self._syncs += 1
        for pdo in TPDOS:
            setting = self._setting(pdo)
            if 1 <= setting.kind <= 240 and self._syncs % setting.kind == 0:
                self._send(setting)

    def _send_timed(self, pdo: Pdo, now: float) -> None:
        setting = self._setting(pdo)
        if setting.kind < 254 or not setting.time:
            return
        if now >= self._timers.setdefault(pdo.name, now + setting.time):
            self._timers[pdo.name] = now + setting.time
            self._send(setting)

    def _send(self, setting: _Setting) -> None:
        if setting.identifier >> 31 or not self._operational:
            return
        try:
            data = b"".join(self._node.get_data(index, sub) for index, sub, _ in setting.objects)
        except SdoAbortedError:
            return
        if len(data) <= 8:
            self._outbox.send(frame_of(setting.identifier & 0x7FF, data))

    def _take(self, identifier: int, data: bytearray) -> None:
        setting = self._setting(RPDO)
        if setting.identifier != identifier:
            return
        for index, sub, size in setting.objects:
            try:
                self._node.set_data(index, sub, bytes(data[:size]))
            except SdoAbortedError:
                return
            data = data[size:]


def _limited(value: float, bits: int) -> int:
    end = (1 << bits - 1) - 1
    return round(min(max(value, -end), end))


def _check(options: Mapping[str, Any]) -> None:
    for name, unit in (("increments", ""), ("rated_torque", "N m"), ("rated_current", "A")):
        check_range(name, options[name], unit, above=0.0)


def _registers() -> Sequence[Register]:
    rows = []
    for pdo in PDOS:
        way = "to drive" if pdo.to_drive else "from drive"
        rows.append(Register(f"{pdo.cob_id:#05x} + node", way, pdo.name, pdo.layout.fields))
    for row in OBJECTS.values():
        counts = row.sub == 0 and row.index in (0x1016, 0x1018, 0x608F)
        if not (counts or 0x1400 <= row.index < 0x1B00):
            way = "both" if row.access == "rw" else "from drive"
            rows.append(Register(f"{row.index:#06x}:{row.sub:02x}", way, row.name, [row.field]))
    return rows


CIA402: Final = DriveProtocol(
    name="cia402",
    title="CiA 402 over CANopen, cyclic synchronous torque",
    side="motor",
    before=(
        "Commission the motor; set node and bit rate. The options are compared with the drive's "
        "objects 0x608F, 0x6075 and 0x6076 and must agree. PDOs, heartbeats and the mode of "
        "operation are set over the bus; nothing is saved in the drive."
    ),
    nodes=(1, 126),
    options={
        "increments": Option(65536, "increments of the encoder per revolution of the motor"),
        "velocity_units": Option(
            0.0, "velocity of the drive at one revolution per second; 0: increments per second"
        ),
        "rated_torque": Option(1.0, "rated torque of the motor [N m], as in object 0x6076"),
        "rated_current": Option(1.0, "rated current of the motor [A], as in object 0x6075"),
        "map_pdos": Option(True, "map the PDOs; false where the drive has these fixed"),
        "master_node": Option(127, "node of the master's heartbeat", range(1, 128)),
    },
    check=_check,
    master=Cia402Master,
    firmware=Cia402Firmware,
    registers=_registers,
)
