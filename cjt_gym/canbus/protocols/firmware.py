"""The drive's side of a protocol: what all emulated drives share, and their periodic reports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from math import isfinite

from cjt_gym.canbus.protocols.contract import Fault, Message, Mode, Settings


class Firmware(ABC):
    """An emulated drive; the joint's physics is handed in.

    Its subclasses speak the protocol. Modes, watchdog and limits are here.

    Attributes:
        settings: Settings of the drive.
        mode: Mode of the drive.
        fault: Reason for which it stopped, if it did.
        watchdog: Time without a command after which it stops [s]; 0 for no watchdog.
        in_torque_mode: Whether it controls torque; other modes make none here.
        forgiving: Whether it stays enabled without torque when the watchdog expires, and obeys the
            next command; otherwise it faults.
    """

    forgiving = False

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.mode = Mode.BOOTING
        self.fault: Fault | None = None
        self.watchdog = settings.limits.watchdog
        self.in_torque_mode = True
        self._channels: Mapping[str, float] = {}
        self._demand = self._heard = 0.0

    @abstractmethod
    def boot(self, now: float) -> Sequence[Message]:
        """Power up, and return the frames sent at that time."""

    def heeds(self, frame: Message) -> bool:
        """Return whether a frame may be for this drive; others need not be handed to it."""
        return True

    @abstractmethod
    def receive(self, frame: Message, now: float) -> Sequence[Message]:
        """Take a frame from the bus, and return the answers."""

    def update(self, channels: Mapping[str, float], now: float) -> Sequence[Message]:
        """Take the joint's present values, and return the reports due.

        Watchdog and limits act here, so call it at least once per millisecond of `now`.

        Args:
            channels: Values of :data:`CHANNELS`, link side.
            now: Time [s].
        """
        self._channels = channels
        self._act()
        self._supervise(now)
        return self._due(now)

    def _act(self) -> None:  # noqa: B027  # only drives with gains act on their own
        """Set the torque that follows from the last command and the present values."""

    def _due(self, now: float) -> Sequence[Message]:
        """Return the reports due; none where a drive reports only when asked."""
        return []

    @property
    def torque(self) -> float:
        """Present motor torque, link side [N m]; 0 unless enabled."""
        return self._demand if self.mode is Mode.ENABLED and self.in_torque_mode else 0.0

    def fail(self, fault: Fault) -> None:
        """Switch off because of a fault."""
        self.mode, self.fault, self._demand = Mode.FAULT, fault, 0.0

    # ---- what subclasses call
    def _power_up(self) -> None:
        """Start disabled, without a fault."""
        self.mode, self.fault, self._demand = Mode.DISABLED, None, 0.0

    def _enable(self, now: float) -> bool:
        """Switch on with zero torque; return whether that succeeded."""
        if self.mode is Mode.DISABLED:
            self.mode, self._demand, self._heard = Mode.ENABLED, 0.0, now
        return self.mode is Mode.ENABLED

    def _disable(self) -> None:
        """Switch off; a fault remains."""
        self._demand = 0.0
        if self.mode is Mode.ENABLED:
            self.mode = Mode.DISABLED

    def _clear(self) -> None:
        """Go from a fault to disabled."""
        if self.mode is Mode.FAULT:
            self.mode, self.fault = Mode.DISABLED, None

    def _shaft(self) -> tuple[float, float]:
        """Return angle [rad] and velocity [rad/s] of the drive's shaft."""
        scaling, channels = self.settings.scaling, self._channels
        angle = scaling.drive_angle(channels.get("q_m", 0.0))
        return angle, scaling.drive_rate(channels.get("dq_m", 0.0))

    def _feed(self, now: float) -> None:
        """Feed the watchdog."""
        self._heard = now

    def _ask(self, tau_m: float) -> None:
        """Set the torque [N m, link side]; a value that is not finite gives zero."""
        limit = self.settings.limits.tau_m
        self._demand = min(max(tau_m, -limit), limit) if isfinite(tau_m) else 0.0

    def _supervise(self, now: float) -> None:
        """Enter a fault if the joint exceeds the limits or the watchdog has expired."""
        if self.mode is not Mode.ENABLED:
            return
        channels, limits = self._channels, self.settings.limits
        if self.watchdog and now - self._heard > self.watchdog:
            if self.forgiving:
                self._demand = 0.0
            else:
                self.fail(Fault.WATCHDOG)
        if abs(channels.get("dq_m", 0.0)) > limits.dq_m:
            self.fail(Fault.OVER_SPEED)
        if channels.get("temperature", 0.0) > limits.temperature:
            self.fail(Fault.OVER_TEMPERATURE)


class Cycles:
    """Periodic reports of a node, each with its own period."""

    def __init__(self, periods: Mapping[str, float]) -> None:
        """Prepare without starting."""
        self._periods = periods
        self._due: dict[str, float] = {}

    def begin(self, now: float) -> None:
        """Start all cycles at a time [s]."""
        self._due = {name: now + period for name, period in self._periods.items()}

    def due(self, now: float) -> list[str]:
        """Return the names of the reports due by a time [s]."""
        names = [name for name, due in self._due.items() if now >= due]
        for name in names:
            self._due[name] = max(self._due[name] + self._periods[name], now)
        return names
