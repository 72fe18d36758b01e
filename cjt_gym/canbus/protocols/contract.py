"""Interface of drive protocols: a master, and what it shares with the firmware of emulated drives.

Neither uses a bus, clock or thread: frames go in and out, and time is an argument. So both run
against real drives, against each other, and in tests at any speed. All values are SI and on the
link side, named as the columns of a record; :class:`Scaling` converts the drive's own units.

The order in which a master is used::

    master.configure() -> steps        once, after the drive is heard
    master.clear() -> steps            to leave a fault
    master.enable() -> steps           torque zero, then the power stage on
    master.command(tau_m) -> frames    every period while enabled
    master.poll() -> frames            every period while not enabled
    master.disable() -> frames         torque zero and off; needs no answer, may come at any time
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Any, Final

from can import Message as Message

CHANNELS: Final = {
    "q_m": ("rad", "angle of the motor"),
    "dq_m": ("rad/s", "velocity of the motor"),
    "tau_m": ("N m", "motor torque, as the drive makes it out from its current"),
    "i": ("A", "motor current, q axis"),
    "q_g": ("rad", "angle of the gear"),
    "dq_g": ("rad/s", "velocity of the gear"),
    "q_l": ("rad", "angle of the load"),
    "dq_l": ("rad/s", "velocity of the load"),
    "tau": ("N m", "joint torque, from its sensor"),
    "temperature": ("degC", "hottest temperature of motor and power stage"),
    "v_bus": ("V", "supply voltage"),
}
"""What nodes may report: unit and meaning. All but the last two are on the link side."""
SLOW: Final[Mapping[str, float]] = {"temperature": 5.0, "v_bus": 5.0}
"""Channels that change slowly, and how old their values may be [s], however often they come."""


class Mode(Enum):
    """Mode of a drive."""

    BOOTING = "booting"
    DISABLED = "disabled"
    ENABLED = "enabled"
    FAULT = "fault"


class Fault(Enum):
    """Reason for which a drive has stopped; every protocol has its own codes for these."""

    WATCHDOG = "no command in time"
    OVER_TEMPERATURE = "too hot"
    OVER_CURRENT = "too much current"
    OVER_VOLTAGE = "supply voltage too high"
    UNDER_VOLTAGE = "supply voltage too low"
    OVER_SPEED = "too fast"
    ENCODER = "encoder failed"
    STOPPED = "emergency stop"
    OTHER = "another fault"


@dataclass(frozen=True)
class Update:
    """Content of a frame; what it does not contain is absent.

    Attributes:
        channels: Values of :data:`CHANNELS`, link side, SI.
        mode: The mode, if given.
        error: The drive's error code, if given; 0 for no error.
        text: The error in words.
    """

    channels: Mapping[str, float] = field(default_factory=dict)
    mode: Mode | None = None
    error: int | None = None
    text: str = ""


@dataclass(frozen=True)
class Step:
    """Frames to send, and the confirmation that the next step requires.

    Attributes:
        text: Description of the step.
        frames: Frames to send, in order.
        confirmed: Returns whether a frame confirms the step, or raises ProtocolError if the drive
            refuses. None if no confirmation is needed.
        timeout: Time to wait for it [s].
        meanwhile: Frames to send once per period while waiting, to feed the watchdog and poll the
            state.
        optional: Whether the next step may follow without confirmation.
    """

    text: str
    frames: Sequence[Message]
    confirmed: Callable[[Message], bool] | None = None
    timeout: float = 0.5
    meanwhile: Sequence[Message] = ()
    optional: bool = False


@dataclass(frozen=True)
class Scaling:
    """From the drive's shaft to the link side: ``q = sign * (angle - offset) / gear_ratio``.

    Attributes:
        gear_ratio: Turns of the drive's shaft per turn of the link; 1 if it counts at the gear's
            output.
        sign: -1 if the drive counts in the opposite direction.
        offset: The drive's reading at zero angle [rad, drive's shaft].
        torque_constant: Torque at the drive's shaft per ampere [N m/A], for protocols that know
            currents only; otherwise None.
    """

    gear_ratio: float = 1.0
    sign: int = 1
    offset: float = 0.0
    torque_constant: float | None = None

    def angle(self, of_drive: float) -> float:
        """Return the link-side angle [rad] of an angle of the drive's shaft [rad]."""
        return self.sign * (of_drive - self.offset) / self.gear_ratio

    def rate(self, of_drive: float) -> float:
        """Return the link-side velocity [rad/s] of a velocity of the drive's shaft [rad/s]."""
        return self.sign * of_drive / self.gear_ratio

    def torque(self, of_drive: float) -> float:
        """Return the link-side torque [N m] of a torque of the drive's shaft [N m]."""
        return self.sign * of_drive * self.gear_ratio

    def drive_angle(self, q: float) -> float:
        """Return the angle of the drive's shaft [rad] of a link-side angle [rad]."""
        return self.sign * q * self.gear_ratio + self.offset

    def drive_rate(self, dq: float) -> float:
        """Return the velocity of the drive's shaft [rad/s] of a link-side velocity [rad/s]."""
        return self.sign * dq * self.gear_ratio

    def drive_torque(self, tau: float) -> float:
        """Return the torque of the drive's shaft [N m] of a link-side torque [N m]."""
        return self.sign * tau / self.gear_ratio


@dataclass(frozen=True)
class Limits:
    """Limits beyond which an emulated drive stops; link side.

    Attributes:
        tau_m: Torque to which it clips commands [N m].
        dq_m: Speed [rad/s].
        temperature: Of motor or power stage [degC].
        watchdog: Watchdog time stored in the drive with its maker's tool [s]; 0 is the factory
            setting, which for most drives is off.
    """

    tau_m: float = inf
    dq_m: float = inf
    temperature: float = inf
    watchdog: float = 0.0


@dataclass(frozen=True)
class Settings:
    """Settings of a protocol for one drive.

    Attributes:
        node: Its address, in the protocol's range.
        scaling: From its shaft to the link side.
        period: Time between two commands [s].
        watchdog: Time without a command after which the drive must stop by itself [s].
        options: Options of the protocol, checked by its row in the table.
        limits: Limits of the emulated drive.
        unwatched: Whether to accept a drive that cannot prove that it stops by itself.
    """

    node: int = 1
    scaling: Scaling = field(default_factory=Scaling)
    period: float = 2e-3
    watchdog: float = 0.05
    options: Mapping[str, Any] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
    unwatched: bool = False


class Master(ABC):
    """The commanding side of a protocol, for one drive.

    Attributes:
        settings: Settings of the drive.
        channels: Names of the :data:`CHANNELS` that this drive reports.
        periods: Time between two reports of each channel while commanded [s].
        torque_range: Range of motor torques that a command can carry, link side [N m].
        shows_stop: Whether its reports distinguish a drive that has stopped by itself from one that
            is on.
    """

    def __init__(
        self, settings: Settings, periods: Mapping[str, float], tau_m: float = inf
    ) -> None:
        self.settings = settings
        self.periods = periods
        self.channels = frozenset(periods)
        self.torque_range = (-tau_m, tau_m)
        self.shows_stop = True

    @abstractmethod
    def configure(self) -> Iterable[Step]:
        """Return the steps that start the drive's reports and its watchdog."""

    @abstractmethod
    def clear(self) -> Sequence[Step]:
        """Return the steps from a fault to disabled."""

    @abstractmethod
    def enable(self) -> Sequence[Step]:
        """Return the steps to torque control, at zero torque."""

    @abstractmethod
    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the frames for a motor torque [N m, link side].

        Raises:
            ProtocolError: The torque is not finite, or outside `torque_range`.
        """

    @abstractmethod
    def commanded(self, frame: Message) -> float | None:
        """Return the motor torque commanded by a frame of a master [N m, link side].

        It is the argument of :meth:`command`, or None for a frame that is not a command to this
        drive.

        Raises:
            ProtocolError: The frame is a command that breaks the protocol.
        """

    @abstractmethod
    def poll(self) -> Sequence[Message]:
        """Return the frames that poll the drive without commanding it, if it needs polling."""

    @abstractmethod
    def disable(self) -> Sequence[Message]:
        """Return the frames for zero torque and power stage off."""

    @abstractmethod
    def decode(self, frame: Message) -> Update | None:
        """Decode a frame; return None if it is not from this drive.

        Raises:
            ProtocolError: The frame is from this drive and breaks the protocol.
        """


def frame_of(
    arbitration_id: int,
    data: bytes = b"",
    *,
    extended: bool = False,
    remote: bool = False,
    fd: bool = False,
) -> Message:
    """Return a frame; CAN FD frames switch to the fast bit rate."""
    return Message(
        arbitration_id=arbitration_id,
        data=data,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=fd,
    )


def is_plain(frame: Message, arbitration_id: int) -> bool:
    """Return whether it is a data frame with this 11-bit identifier."""
    return (
        frame.arbitration_id == arbitration_id
        and not frame.is_extended_id
        and not frame.is_remote_frame
        and not frame.is_error_frame
    )
