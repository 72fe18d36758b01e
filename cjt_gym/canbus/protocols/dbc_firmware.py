"""Any DBC file: the node's side, and the row of the table of protocols."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final

from cjt_gym.canbus.protocols.contract import Fault, Message, Settings
from cjt_gym.canbus.protocols.dbc import (
    Codec,
    DbcMaster,
    mapping_of,
    range_of,
    torque_of_command,
)
from cjt_gym.canbus.protocols.dbc_mapping import Signal
from cjt_gym.canbus.protocols.firmware import Cycles, Firmware
from cjt_gym.canbus.protocols.row import DriveProtocol, Option
from cjt_gym.errors import ProtocolError


def _by_message(signals: Iterable[Signal]) -> dict[str, list[str]]:
    made: dict[str, list[str]] = defaultdict(list)
    for message, signal in signals:
        made[message].append(signal)
    return made


class DbcFirmware(Firmware):
    """Behaves as the mapping's node; see the contract's `Firmware`."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._mapping = mapping = mapping_of(settings)
        self._codec = Codec(mapping)
        self._per_unit = torque_of_command(mapping, settings)
        reported = [where for where, _ in mapping.channels.values()]
        reported += [where for where in (mapping.state, mapping.error) if where]
        self._reports = _by_message(reported)
        commands = [where for phase in mapping.phases.values() for where in phase]
        commands += [mapping.command[0]] if mapping.command else []
        self._commands = _by_message(commands)
        self._told: dict[Signal, float] = {}
        self._cycles = Cycles(
            {name: mapping.cycles.get(name, settings.period) for name in self._reports}
        )

    def boot(self, now: float) -> Sequence[Message]:
        """Start with all reports."""
        self._power_up()
        self._told = {}
        self._cycles.begin(now)
        return [self._report(name) for name in self._reports]

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a command, without an answer."""
        try:
            found = self._codec.decode(frame, self._commands)
        except ProtocolError:
            return []
        if found is None:
            return []
        message, values = found
        self._told |= {(message, signal): value for signal, value in values.items()}
        self._obey(now)
        if self._mapping.command and self._mapping.command[0][0] == message:
            where, column = self._mapping.command
            self._feed(now)
            told = self._per_unit * column.gain * (self._told[where] - column.offset)
            self._ask(told)
        return []

    def _due(self, now: float) -> Sequence[Message]:
        return [self._report(name) for name in self._cycles.due(now)]

    def _obey(self, now: float) -> None:
        if self._in_phase("clear"):
            self._clear()
        if self._in_phase("enabled") or not self._mapping.phases["enabled"]:
            self._enable(now)
        elif self._in_phase("disabled"):
            self._disable()

    def _in_phase(self, phase: str) -> bool:
        wanted = self._mapping.phases[phase]
        return bool(wanted) and all(self._told.get(key) == value for key, value in wanted.items())

    def _report(self, message: str) -> Message:
        values: dict[str, float] = {}
        for name, ((where, signal), column) in self._mapping.channels.items():
            if where == message:
                shown = self._channels.get(name, 0.0) / column.gain + column.offset
                low, high = range_of(self._codec.signal((where, signal)))
                values[signal] = min(max(shown, low), high)
        if self._mapping.state and self._mapping.state[0] == message:
            values[self._mapping.state[1]] = self._mapping.modes.get(self.mode, (0,))[0]
        if self._mapping.error and self._mapping.error[0] == message:
            code = list(Fault).index(self.fault) + 2 if self.fault else 0
            values[self._mapping.error[1]] = code
        return self._codec.encode(message, values)


DBC: Final = DriveProtocol(
    name="dbc",
    title="Any DBC file with a mapping",
    side="motor",
    before=(
        "Find out which signals enable the drive, and whether it stops by itself when commands "
        "stop arriving. It has to show this in `state` or `error`; otherwise it can only be armed "
        "with `unwatched = true`, and somebody should be at the emergency switch."
    ),
    nodes=(0, 0x1FFFFFFF),
    options={
        "file": Option(
            "joint_sensor", "the mapping, or the name of one that comes with the package"
        )
    },
    master=DbcMaster,
    firmware=DbcFirmware,
    command_enables=True,
)
