"""CiA 402 over CANopen, cyclic synchronous torque: the master's side.

A command is an RPDO with controlword and target torque, followed by a SYNC. The drive answers with
two TPDOs: state, position and torque; velocity, current and error. It is configured by SDOs, one at
a time, and monitors the master's heartbeat, which is sent with the commands. What does not depend
on CANopen is in `cia402_profile.py`.

References:
    CiA 301 and CiA 402 (IEC 61800-7-201): the finite state automaton and its controlword.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count
from math import ceil
from typing import Final

from canopen.sdo.exceptions import SdoAbortedError

from cjt_gym.canbus.protocols.cia402_objects import PDOS, Pdo, State
from cjt_gym.canbus.protocols.cia402_profile import ENABLING, Access, Controlword, Profile, write
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
from cjt_gym.canbus.protocols.layout import Field, Layout, nothing
from cjt_gym.errors import ProtocolError

SYNC: Final = 0x080
EMERGENCY: Final = 0x080
SDO_TO_DRIVE, SDO_FROM_DRIVE = 0x600, 0x580
HEARTBEAT: Final = 0x700
START, PRE_OPERATIONAL = 0x01, 0x80
MODES_OF_NODE: Final = {0: Mode.BOOTING, 4: Mode.DISABLED, 127: Mode.DISABLED}
"""Modes by a heartbeat's state: boot-up, stopped, pre-operational."""
HEARTBEAT_MS: Final = 100
"""Time between two heartbeats of the drive [ms]."""
EMERGENCY_LAYOUT: Final = Layout((Field("Error code", 16), Field("Error register", 8), nothing(40)))
RPDO, *TPDOS = PDOS


class Cia402Master(Master):
    """Commands one drive; see :class:`~cjt_gym.canbus.protocols.contract.Master`."""

    def __init__(self, settings: Settings) -> None:
        self.profile = Profile(settings)
        periods = dict.fromkeys(("q_m", "dq_m", "tau_m", "i"), settings.period) | {"v_bus": 0.1}
        high = settings.scaling.gear_ratio * self.profile.rated_torque * 32.767
        super().__init__(settings, periods, high)
        self._layouts = {pdo.cob_id + settings.node: pdo.layout for pdo in TPDOS}
        self._beat_every = max(1, int(settings.watchdog / 3 / settings.period))
        self._count = count()

    def configure(self) -> Sequence[Step]:
        """Return the steps that configure PDOs, heartbeats and torque mode, and start the node."""
        time = max(1, ceil(self.settings.watchdog * 1e3 - 1e-6))  # in whole milliseconds, never off
        watched = self.settings.options["master_node"] << 16 | time
        steps = [
            self._nmt("Pre-operational", PRE_OPERATIONAL),
            self._access(self.profile.identity()),
            self._write((0x1016, 1), 0),
            self._write((0x1017, 0), HEARTBEAT_MS),
            self._access(self.profile.abort()),
        ]
        if self.settings.options["map_pdos"]:
            steps += [step for pdo in PDOS for step in self._map(pdo)]
        steps += [
            *(self._access(each) for each in self.profile.setup()),
            self._write((0x1016, 1), watched),
        ]
        started = self._nmt("Start the node", START)
        sync = frame_of(SYNC)
        heard = Step(
            started.text, [*started.frames, sync], self._shows(None), 1.0, [sync, self._heartbeat()]
        )
        return [*steps, heard]

    def clear(self) -> Sequence[Step]:
        """Return the steps that clear a fault by the rising edge of a bit."""
        reset = self._frames(Controlword.RESET)
        return [
            Step("Lower the reset bit", self._frames(Controlword.DISABLE_VOLTAGE)),
            Step("Reset the fault", reset, self._shows(State.SWITCH_ON_DISABLED), meanwhile=reset),
        ]

    def enable(self) -> Sequence[Step]:
        """Return the steps through the state machine, with zero torque."""
        return [
            Step(text, frames, self._shows(state), 1.0, frames)
            for text, word, state in ENABLING
            for frames in [self._frames(word)]
        ]

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the RPDO, SYNC and, when due, the heartbeat."""
        torque = self.settings.scaling.drive_torque(tau_m)
        beat = [self._heartbeat()] if next(self._count) % self._beat_every == 0 else []
        return [*self._process(Controlword.ENABLE, torque), *beat]

    def commanded(self, frame: Message) -> float | None:
        """Return the target torque of the RPDO; zero if its controlword disables it."""
        if not is_plain(frame, RPDO.cob_id + self.settings.node):
            return None
        return self.settings.scaling.torque(self.profile.commanded(bytes(frame.data)))

    def poll(self) -> Sequence[Message]:
        """Return the RPDO that keeps the voltage off, SYNC and the heartbeat."""
        return self._frames(Controlword.DISABLE_VOLTAGE)

    def disable(self) -> Sequence[Message]:
        """Return the RPDO with zero torque that takes the voltage off."""
        return self._process(Controlword.DISABLE_VOLTAGE, 0.0)

    def decode(self, frame: Message) -> Update | None:
        """Decode a TPDO, an emergency or a heartbeat; answers to SDOs are empty."""
        if frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame:
            return None
        identifier, node = frame.arbitration_id, self.settings.node
        if layout := self._layouts.get(identifier):
            return self.profile.inputs(layout.decode(frame.data))
        if identifier == EMERGENCY + node:
            error = int(EMERGENCY_LAYOUT.decode(frame.data)["Error code"])
            if error == 0:
                return Update(error=0)
            return Update(mode=Mode.FAULT, error=error, text=f"emergency {error:#06x}")
        if identifier == HEARTBEAT + node:
            if not frame.data:
                raise ProtocolError(f"A heartbeat of node {node} must have 1 byte, got none.")
            return Update(mode=MODES_OF_NODE.get(frame.data[0] & 0x7F))
        return None

    def _process(self, word: int, torque: float) -> list[Message]:
        return [
            frame_of(RPDO.cob_id + self.settings.node, self.profile.outputs(word, torque)),
            frame_of(SYNC),
        ]

    def _frames(self, word: int) -> list[Message]:
        return [*self._process(word, 0.0), self._heartbeat()]

    def _heartbeat(self) -> Message:
        return frame_of(HEARTBEAT + self.settings.options["master_node"], b"\x05")

    def _nmt(self, text: str, command: int) -> Step:
        return Step(text, [frame_of(0x000, bytes([command, self.settings.node]))])

    def _shows(self, wanted: int | None) -> Callable[[Message], bool]:
        """Return the test whether a frame shows a state, or any state for None."""
        first = TPDOS[0]
        layout, identifier = first.layout, first.cob_id + self.settings.node

        def confirmed(frame: Message) -> bool:
            if not is_plain(frame, identifier):
                return False
            word = int(layout.decode(frame.data)["Statusword"])
            return self.profile.shows(word, wanted)

        return confirmed

    def _map(self, pdo: Pdo) -> Sequence[Step]:
        """Return the steps that configure a PDO, which is off while its objects change."""
        identifier = pdo.cob_id + self.settings.node
        steps = [
            self._write((pdo.parameters, 1), 1 << 31 | identifier),
            self._write((pdo.parameters, 2), pdo.kind),
            *(self._access(each) for each in self.profile.mapping(pdo)),
        ]
        if pdo.event_ms:
            steps.append(self._write((pdo.parameters, 5), pdo.event_ms))
        return [*steps, self._write((pdo.parameters, 1), identifier)]

    def _write(self, key: tuple[int, int], value: int) -> Step:
        return self._access(write(key, value))

    def _access(self, access: Access) -> Step:
        node = self.settings.node
        address = access.key[0].to_bytes(2, "little") + bytes([access.key[1]])
        reads, data = access.value is None, b"" if access.value is None else access.data
        head = 0x40 if reads else 0x23 | (4 - len(data)) << 2

        def confirmed(frame: Message) -> bool:
            answer = bytes(frame.data)
            if not is_plain(frame, SDO_FROM_DRIVE + node) or len(answer) < 8:
                return False
            if answer[1:4] != address:
                return False
            if answer[0] == 0x80:
                code = SdoAbortedError(int.from_bytes(answer[4:8], "little"))
                raise ProtocolError(f"{access.text}: drive {node} refuses it. {code}.")
            if reads:
                return answer[0] & 0xE2 == 0x42 and access.accepts(answer[4:8])
            return answer[0] == 0x60

        request = bytes([head]) + address + data.ljust(4, b"\0")
        return Step(access.text, [frame_of(SDO_TO_DRIVE + node, request)], confirmed)
