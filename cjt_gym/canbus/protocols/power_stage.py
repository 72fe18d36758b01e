"""What every drive does whatever it speaks: switch on and off, obey, give up, limit itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

from cjt_gym.canbus.protocols.contract import Fault, Limits, Mode

__all__ = ["PowerStage"]


@dataclass
class PowerStage:
    """Modes, watchdog and limits of an emulated drive; a firmware speaks for one.

    Attributes:
        limits: Beyond which it faults.
        watchdog: Time without a command after which it gives up [s]; 0 switches this off.
        forgiving: After its watchdog it makes no torque but stays enabled, and obeys the next
            command; otherwise it faults.
        in_torque_mode: Whether it controls torque; in other modes it makes none here.
        mode: What it is doing.
        fault: Why it stopped by itself.
    """

    limits: Limits
    watchdog: float
    forgiving: bool = False
    in_torque_mode: bool = True
    mode: Mode = Mode.BOOTING
    fault: Fault | None = None
    _demand: float = 0.0
    _heard: float = 0.0

    @property
    def torque(self) -> float:
        """Motor torque that it makes now, link side [N m]."""
        return self._demand if self.mode is Mode.ENABLED and self.in_torque_mode else 0.0

    def boot(self) -> None:
        """Start: disabled, without fault."""
        self.mode, self.fault, self._demand = Mode.DISABLED, None, 0.0

    def enable(self, now: float) -> bool:
        """Switch on with zero torque; return whether it is on."""
        if self.mode is Mode.DISABLED:
            self.mode, self._demand, self._heard = Mode.ENABLED, 0.0, now
        return self.mode is Mode.ENABLED

    def disable(self) -> None:
        """Switch off; a fault stays."""
        self._demand = 0.0
        if self.mode is Mode.ENABLED:
            self.mode = Mode.DISABLED

    def fail(self, fault: Fault) -> None:
        """Switch off because of a fault."""
        self.mode, self.fault, self._demand = Mode.FAULT, fault, 0.0

    def clear(self) -> None:
        """Leave a fault, to disabled."""
        if self.mode is Mode.FAULT:
            self.mode, self.fault = Mode.DISABLED, None

    def feed(self, now: float) -> None:
        """Let the watchdog know that the master lives."""
        self._heard = now

    def demand(self, tau_m: float) -> None:
        """Make this torque from now on [N m, link side]; what is not finite is none."""
        limit = self.limits.tau_m
        self._demand = min(max(tau_m, -limit), limit) if isfinite(tau_m) else 0.0

    def supervise(self, channels: Mapping[str, float], now: float) -> None:
        """Fault where the joint is beyond the limits, or where no command came in time."""
        if self.mode is not Mode.ENABLED:
            return
        if self.watchdog and now - self._heard > self.watchdog:
            if self.forgiving:
                self._demand = 0.0
            else:
                self.fail(Fault.WATCHDOG)
        if abs(channels.get("dq_m", 0.0)) > self.limits.dq_m:
            self.fail(Fault.OVER_SPEED)
        if channels.get("temperature", 0.0) > self.limits.temperature:
            self.fail(Fault.OVER_TEMPERATURE)
        if (volts := channels.get("v_bus")) is not None:
            if volts > self.limits.v_high:
                self.fail(Fault.OVER_VOLTAGE)
            elif volts < self.limits.v_low:
                self.fail(Fault.UNDER_VOLTAGE)
