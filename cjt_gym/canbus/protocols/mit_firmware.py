"""MIT mini cheetah: the drive's side, and the row of the table of protocols."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any, Final

from cjt_gym.canbus.protocols.contract import (
    Fault,
    Message,
    Settings,
    frame_of,
    is_plain,
)
from cjt_gym.canbus.protocols.firmware import Firmware
from cjt_gym.canbus.protocols.mit import (
    ENTER,
    EXIT,
    MODELS,
    ZERO,
    MitMaster,
    command_layout,
    ranges_of,
    reply_layout,
)
from cjt_gym.canbus.protocols.row import DriveProtocol, Option, Register
from cjt_gym.errors import ConfigurationError

CODES: Final = {
    Fault.OVER_TEMPERATURE: 1,
    Fault.OVER_CURRENT: 2,
    Fault.OVER_VOLTAGE: 3,
    Fault.UNDER_VOLTAGE: 4,
    Fault.ENCODER: 5,
}
OTHER: Final = 6
AMBIENT: Final = 25.0
"""Temperature that is shown where none is handed in [degC]."""


class MitFirmware(Firmware):
    """Behaves as a drive; see :class:`~cjt_gym.canbus.protocols.contract.Firmware`."""

    forgiving = True

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        ranges = ranges_of(settings)
        self._layout = command_layout(ranges)
        self._answer = reply_layout(ranges, settings.options["reply_bytes"])
        self._told: Mapping[str, float] = {}
        self._zero = 0.0

    def boot(self, now: float) -> Sequence[Message]:
        """Start silently."""
        self._told = {}
        self._power_up()
        return []

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take and answer a command or a mode."""
        if not is_plain(frame, self.settings.node) or frame.dlc != 8:
            return []
        data = bytes(frame.data)
        if data == ENTER:
            self._enable(now)
        elif data == EXIT:
            self._told = {}
            self._disable()
            self._clear()
        elif data == ZERO:
            self._zero += self._seen()[0]
        else:
            self._told = self._layout.decode(data)
            self._feed(now)
            self._act()
        return [self._reply()]

    def _seen(self) -> tuple[float, float]:
        angle, rate = self._shaft()
        return angle - self._zero, rate

    def _act(self) -> None:
        if told := self._told:
            position, velocity = self._seen()
            torque = (
                told["kp"] * (told["position"] - position)
                + told["kd"] * (told["velocity"] - velocity)
                + told["torque"]
            )
            self._ask(self.settings.scaling.torque(torque))

    def _reply(self) -> Message:
        position, velocity = self._seen()
        tau_m = self._channels.get("tau_m", self.torque)
        shown = {
            "id": self.settings.node,
            "position": position,
            "velocity": velocity,
            "torque": self.settings.scaling.drive_torque(tau_m),
            "temperature": self._channels.get("temperature", AMBIENT),
            "error": CODES.get(self.fault, OTHER) if self.fault else 0,
        }
        clipped = {
            each.name: min(max(shown[each.name], each.range[0]), each.range[1])
            for each in self._answer.fields
        }
        return frame_of(self.settings.options["reply_id"], self._answer.encode(clipped))


def _check(options: Mapping[str, Any]) -> None:
    ranges = options["ranges"]
    numbers = all(isinstance(end, int | float) and 0 < end < inf for end in ranges)
    if ranges and not (len(ranges) == 3 and numbers):
        raise ConfigurationError(
            "ranges must be the three ends of the ranges of angle [rad], velocity [rad/s] and "
            f"torque [N m], each > 0, got {ranges!r}."
        )


def _registers() -> Sequence[Register]:
    ranges = MODELS["AK80-9"]
    return [
        Register("node", "to drive", "command", command_layout(ranges).fields),
        Register("node", "to drive", "enter motor mode", (), ENTER.hex(" ")),
        Register("node", "to drive", "exit motor mode", (), EXIT.hex(" ")),
        Register("node", "to drive", "set zero; never sent", (), ZERO.hex(" ")),
        Register("reply_id", "from drive", "reply", reply_layout(ranges).fields),
    ]


MIT: Final = DriveProtocol(
    name="mit",
    title="MIT mini cheetah, CubeMars AK series",
    side="output",
    before=(
        "Calibrate the motor; set its CAN identifier, the MIT mode, and its CAN timeout, which is "
        "the only watchdog. Without a timeout the drive keeps the last torque, and no frame shows "
        "whether a timeout is set, so it can only be armed with `unwatched = true`. Angles and "
        "velocities at the ends of their ranges count as unknown; choose the zero so that the "
        "joint stays between them."
    ),
    nodes=(1, 255),
    options={
        "model": Option("AK80-9", "the drive's model, which sets the ranges", tuple(MODELS)),
        "ranges": Option((), "ends of the ranges of angle, velocity, torque, instead of a model"),
        "reply_id": Option(0, "identifier of the replies: that of the master"),
        "reply_bytes": Option(8, "bytes of a reply: 6 for firmwares without temperature", (6, 8)),
    },
    check=_check,
    master=MitMaster,
    firmware=MitFirmware,
    registers=_registers,
)
