"""What every drive protocol is: a master and a firmware that turn values into frames and back.

Neither touches a bus, a clock or a thread: frames go in, frames come out, and the time is an
argument. So the same two run against real drives, against each other in one process, and in tests
at any speed. All values at this border are SI and on the link side, named as the columns of a
record; what a drive itself counts in (motor revolutions, per mille of its rated torque) stays
behind the :class:`Scaling`.

The order in which a master is used::

    master.configure() -> steps        once, after the drive is heard
    master.clear() -> steps            to leave a fault
    master.enable() -> steps           torque zero, then the power stage on
    master.command(tau_m) -> frames    every period while enabled
    master.poll() -> frames            every period while not enabled
    master.disable() -> frames         torque zero and off; needs no answer, may come at any time
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import inf
from typing import Any, Final, Protocol

from can import Message

from cjt_gym.errors import ConfigurationError

__all__ = [
    "CHANNELS",
    "NO_CHANNELS",
    "SLOW",
    "Fault",
    "Firmware",
    "Limits",
    "Master",
    "Message",
    "Mode",
    "Scaling",
    "Settings",
    "Step",
    "Update",
    "frame_of",
    "is_plain",
]

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
NO_CHANNELS: Final[Mapping[str, float]] = {}


class Mode(Enum):
    """What a drive is doing."""

    BOOTING = "booting"
    DISABLED = "disabled"
    ENABLED = "enabled"
    FAULT = "fault"


class Fault(Enum):
    """Why a drive has stopped by itself; every protocol has its own codes for these."""

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
    """What one frame says; what it does not say is absent.

    Attributes:
        channels: Values by the names of :data:`CHANNELS`, link side, SI.
        mode: The mode it shows, if it shows one.
        error: The drive's own error code, 0 for none, if it shows one.
        text: That error in words.
    """

    channels: Mapping[str, float] = field(default_factory=dict)
    mode: Mode | None = None
    error: int | None = None
    text: str = ""


@dataclass(frozen=True)
class Step:
    """Frames to send, and what has to be heard before the next step.

    Attributes:
        text: What the step does, in words.
        frames: To send, in this order.
        confirmed: Says of each frame heard since whether it confirms the step; it raises
            ProtocolError where the drive refuses. None: nothing has to be heard.
        timeout: How long to wait for it [s].
        meanwhile: To send once in every period while waiting, so that the drive's watchdog is
            fed and its state is asked for.
        optional: Whether the next step may follow though this one was not confirmed.
    """

    text: str
    frames: Sequence[Message]
    confirmed: Callable[[Message], bool] | None = None
    timeout: float = 0.5
    meanwhile: Sequence[Message] = ()
    optional: bool = False


@dataclass(frozen=True)
class Scaling:
    """From a drive's own shaft to the link side: ``q = sign * (angle - offset) / gear_ratio``.

    Attributes:
        gear_ratio: Turns of the drive's shaft per turn of the link; 1 for a drive that counts at
            the output of its gear.
        sign: -1 where the drive counts the other way round.
        offset: What the drive shows where the angle is zero [rad, drive's shaft].
        torque_constant: Torque of the drive's shaft per ampere [N m/A], where a protocol commands
            or reports currents only; None if not needed.

    Raises:
        ConfigurationError: A value is out of its range.
    """

    gear_ratio: float = 1.0
    sign: int = 1
    offset: float = 0.0
    torque_constant: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.gear_ratio < inf:
            raise ConfigurationError(f"gear_ratio must be > 0, got {self.gear_ratio}.")
        if self.sign not in (1, -1):
            raise ConfigurationError(f"sign must be 1 or -1, got {self.sign}.")
        if not -inf < self.offset < inf:
            raise ConfigurationError(f"offset must be a finite angle [rad], got {self.offset}.")
        if self.torque_constant is not None and not 0.0 < self.torque_constant < inf:
            raise ConfigurationError(
                f"torque_constant must be > 0 N m/A, got {self.torque_constant}."
            )

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
    """Beyond these an emulated drive stops, whatever the command; link side.

    Attributes:
        tau_m: Torque above which it clips what it is told [N m].
        dq_m: Speed [rad/s].
        temperature: Of motor or power stage [degC].
        v_low: Lowest supply voltage [V].
        v_high: Highest supply voltage [V].
        watchdog: Time without a command, as set in the drive before, with its maker's tool [s]; 0:
            as the drive leaves the factory, which for most is without a watchdog.
    """

    tau_m: float = inf
    dq_m: float = inf
    temperature: float = inf
    v_low: float = -inf
    v_high: float = inf
    watchdog: float = 0.0


@dataclass(frozen=True)
class Settings:
    """What makes a protocol that of one drive on one bus.

    Attributes:
        node: Its address, in the protocol's range.
        scaling: From its shaft to the link side.
        period: Time between two commands [s].
        watchdog: Time without a command after which the drive has to stop by itself [s].
        options: What only this protocol knows, checked by its row in the table of protocols.
        limits: Of the emulated drive.
        unwatched: Whether it is accepted that the drive does not show that it stops by itself.
    """

    node: int = 1
    scaling: Scaling = field(default_factory=Scaling)
    period: float = 2e-3
    watchdog: float = 0.05
    options: Mapping[str, Any] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
    unwatched: bool = False


class Master(Protocol):
    """The commanding side of a protocol, for one drive.

    Attributes:
        channels: The names of :data:`CHANNELS` that this drive reports.
        periods: For each of these the time between two reports while it is commanded [s].
        torque_range: Lowest and highest motor torque that a command can carry, link side [N m].
        shows_stop: Whether its reports tell a drive that has stopped by itself from one that is on.
    """

    @property
    def channels(self) -> frozenset[str]: ...  # noqa: D102

    @property
    def periods(self) -> Mapping[str, float]: ...  # noqa: D102

    @property
    def torque_range(self) -> tuple[float, float]: ...  # noqa: D102

    @property
    def shows_stop(self) -> bool: ...  # noqa: D102

    def configure(self) -> Iterable[Step]:
        """Return the steps that make the drive report, and stop by itself when not commanded."""
        ...

    def clear(self) -> Sequence[Step]:
        """Return the steps out of a fault, to disabled."""
        ...

    def enable(self) -> Sequence[Step]:
        """Return the steps to torque control with zero torque."""
        ...

    def command(self, tau_m: float) -> Sequence[Message]:
        """Return the frames for a motor torque [N m, link side].

        Raises:
            ProtocolError: The torque is not finite, or not within `torque_range`.
        """
        ...

    def commanded(self, frame: Message) -> float | None:
        """Return the motor torque that a frame of a master commands [N m, link side].

        None for a frame that is no command to this drive. It is what :meth:`command` would have
        been given, whatever the drive makes of it.

        Raises:
            ProtocolError: The frame is a command and breaks the protocol.
        """
        ...

    def poll(self) -> Sequence[Message]:
        """Return the frames that ask for a report without commanding, if it has to be asked."""
        ...

    def disable(self) -> Sequence[Message]:
        """Return the frames that set zero torque and switch the power stage off."""
        ...

    def decode(self, frame: Message) -> Update | None:
        """Return what a frame says, or None if it is not from this drive.

        Raises:
            ProtocolError: The frame is this drive's and breaks the protocol.
        """
        ...


class Firmware(Protocol):
    """The drive's side of a protocol; the physics of the joint is handed in.

    Attributes:
        mode: What the drive is doing.
        fault: Why it stopped by itself, if it did.
        torque: Motor torque that it makes now, link side [N m]; 0 unless enabled.
    """

    @property
    def mode(self) -> Mode: ...  # noqa: D102

    @property
    def fault(self) -> Fault | None: ...  # noqa: D102

    @property
    def torque(self) -> float: ...  # noqa: D102

    def boot(self, now: float) -> Sequence[Message]:
        """Start, as after switching the supply on, and return what it says then."""
        ...

    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a frame from the bus and return the answers; a frame for others has none."""
        ...

    def update(self, channels: Mapping[str, float], now: float) -> Sequence[Message]:
        """Take the joint's present values and return the reports that are due.

        Watchdog and limits act here, so it is called at least once a millisecond of `now`.

        Args:
            channels: Values by the names of :data:`CHANNELS`, link side.
            now: Time [s].
        """
        ...

    def fail(self, fault: Fault) -> None:
        """Fault now, as if by itself."""
        ...


def frame_of(
    arbitration_id: int,
    data: bytes = b"",
    *,
    extended: bool = False,
    remote: bool = False,
    fd: bool = False,
) -> Message:
    """Return a frame; CAN FD frames are sent with the fast bit rate."""
    return Message(
        arbitration_id=arbitration_id,
        data=data,
        is_extended_id=extended,
        is_remote_frame=remote,
        is_fd=fd,
        bitrate_switch=fd,
    )


def is_plain(frame: Message, arbitration_id: int) -> bool:
    """Return whether it is a frame with data and this identifier of 11 bits."""
    return (
        frame.arbitration_id == arbitration_id
        and not frame.is_extended_id
        and not frame.is_remote_frame
        and not frame.is_error_frame
    )
