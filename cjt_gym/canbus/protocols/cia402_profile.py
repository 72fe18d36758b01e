"""CiA 402 without the bus: commands and reports as objects of the drive's dictionary.

CANopen (`cia402.py`) carries it in SDOs and PDOs on CAN. EtherCAT carries the same objects and
process data (CoE), so a transport such as pysoem can use this module unchanged: each `Access` of
`identity`, `abort`, `mapping` and `setup` becomes a call of `sdo_write` or `sdo_read`; in every
cycle `outputs` fills the slave's output bytes, and its input bytes, decoded by the layouts of
`PDOS[1:]`, go into `inputs`. `ENABLING` lists the transitions into operation. The transport assigns
the PDOs to the sync managers (1C12h, 1C13h). EtherCAT's state machine, cycle and sync manager
watchdog replace NMT, SYNC and heartbeat.

References:
    CiA 402 (IEC 61800-7-201); ETG.6010, Implementation Directive for CiA 402 Drive Profile.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import tau
from typing import Final

from cjt_gym.canbus.protocols.cia402_objects import CST, OBJECTS, PDOS, Pdo, State, state_of
from cjt_gym.canbus.protocols.contract import Mode, Settings, Update
from cjt_gym.canbus.protocols.layout import Layout
from cjt_gym.errors import ProtocolError

Key = tuple[int, int]


class Controlword:
    """Commands to the state machine."""

    DISABLE_VOLTAGE: Final = 0x00
    SHUTDOWN: Final = 0x06
    SWITCH_ON: Final = 0x07
    ENABLE: Final = 0x0F
    RESET: Final = 0x80


ENABLING: Final = (
    ("Switch on disabled", Controlword.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    ("Ready to switch on", Controlword.SHUTDOWN, State.READY),
    ("Switched on", Controlword.SWITCH_ON, State.SWITCHED_ON),
    ("Operation enabled", Controlword.ENABLE, State.ENABLED),
)
"""The way into operation: what to wait for, its controlword, and the state that shows it."""
RUNNING: Final = (State.READY, State.SWITCHED_ON, State.ENABLED)
_MODES: Final = {
    State.NOT_READY: Mode.BOOTING,
    State.ENABLED: Mode.ENABLED,
    State.FAULT: Mode.FAULT,
    State.FAULT_REACTION: Mode.FAULT,
}


@dataclass(frozen=True)
class Access:
    """One access to an object of the dictionary: writes a value, or reads and checks one."""

    text: str
    key: Key
    value: int | None = None
    accept: Callable[[int], bool] | None = None

    @property
    def data(self) -> bytes:
        """The value to write, encoded."""
        assert self.value is not None
        field = OBJECTS[self.key].field
        return field.to_bits(self.value).to_bytes(field.bits // 8, "little")

    def accepts(self, data: bytes) -> bool:
        """Return whether the value that was read is right."""
        field = OBJECTS[self.key].field
        bits = int.from_bytes(data[: field.bits // 8], "little")
        return self.accept is None or self.accept(int(field.from_bits(bits)))


def write(key: Key, value: int) -> Access:
    """Return the access that writes an object."""
    return Access(f"Write {OBJECTS[key].name}", key, value)


class Profile:
    """Commands and reports of one drive; see the module."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        options = settings.options
        self.increments: int = options["increments"]
        self._velocity = options["velocity_units"] or float(self.increments)
        self.rated_torque: float = options["rated_torque"]
        self.rated_current: float = options["rated_current"]
        self.output: Layout = PDOS[0].layout

    def identity(self) -> Access:
        """Return the access that checks for a drive of this profile."""
        return Access("Look for a drive", (0x1000, 0), accept=self._is_a_drive)

    def abort(self) -> Access:
        """Return the access that makes a broken connection a fault."""
        return write((0x6007, 0), 1)

    def setup(self) -> Sequence[Access]:
        """Return the accesses that check the drive's ratings and select torque mode."""
        return (
            self._compare((0x6076, 0), round(self.rated_torque * 1e3)),
            self._compare((0x6075, 0), round(self.rated_current * 1e3)),
            self._compare((0x608F, 1), self.increments),
            write((0x6071, 0), 0),
            write((0x6060, 0), CST),
        )

    def mapping(self, pdo: Pdo) -> Sequence[Access]:
        """Return the accesses that define the objects of a PDO."""
        entries = [
            index << 16 | sub << 8 | OBJECTS[index, sub].field.bits for index, sub in pdo.objects
        ]
        return (
            write((pdo.mapping, 0), 0),
            *(write((pdo.mapping, at), entry) for at, entry in enumerate(entries, 1)),
            write((pdo.mapping, 0), len(entries)),
        )

    def outputs(self, word: int, torque: float) -> bytes:
        """Return the process data that command a state and a torque at the drive [N m]."""
        values = {"Controlword": word, "Target torque": torque / self.rated_torque * 1e3}
        return self.output.encode(values)

    def commanded(self, data: bytes) -> float:
        """Return the torque [N m] that process data command; zero if they disable it."""
        values = self.output.decode(data)
        if int(values["Controlword"]) & 0x0F != Controlword.ENABLE:
            return 0.0
        return values["Target torque"] * self.rated_torque / 1e3

    def inputs(self, values: Mapping[str, float]) -> Update:
        """Decode process data of the drive, given by the names of their objects."""
        scaling = self.settings.scaling
        channels = {}
        if (raw := values.get("Position")) is not None:
            channels["q_m"] = scaling.angle(raw / self.increments * tau)
        if (raw := values.get("Velocity")) is not None:
            channels["dq_m"] = scaling.rate(raw / self._velocity * tau)
        if (raw := values.get("Torque")) is not None:
            channels["tau_m"] = scaling.torque(raw * self.rated_torque / 1e3)
        if (raw := values.get("Current")) is not None:
            channels["i"] = scaling.sign * raw * self.rated_current / 1e3
        if (raw := values.get("DC link voltage")) is not None:
            channels["v_bus"] = raw / 1e3
        mode = None
        if (word := values.get("Statusword")) is not None:
            mode = _MODES.get(state_of(int(word)), Mode.DISABLED)
        code = values.get("Error code")
        error = None if code is None else int(code)
        return Update(channels, mode, error, f"error {error:#06x}" if error else "")

    def shows(self, statusword: int, wanted: int | None) -> bool:
        """Return whether a statusword shows a state, or any state for None."""
        state = state_of(statusword)
        if wanted in RUNNING and state in (State.FAULT, State.FAULT_REACTION):
            raise ProtocolError(f"Drive {self.settings.node} refuses to run: it has a fault.")
        return wanted is None or state == wanted

    def _compare(self, key: Key, expected: int) -> Access:
        row = OBJECTS[key]

        def accept(value: int) -> bool:
            if value != expected:
                raise ProtocolError(
                    f"{row.name} of drive {self.settings.node} must be {expected} "
                    f"{row.field.unit} as configured, but the drive has {value}. Correct one."
                )
            return True

        return Access(f"Compare {row.name}", key, accept=accept)

    def _is_a_drive(self, device_type: int) -> bool:
        if device_type & 0xFFFF != 402:
            raise ProtocolError(
                f"Node {self.settings.node} must be a drive of profile 402, it has the profile "
                f"{device_type & 0xFFFF}."
            )
        return True
