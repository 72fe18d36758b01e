"""The power stage of an emulated drive, independent of its protocol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

from cjt_gym.canbus.protocols.contract import Fault, Limits, Mode

__all__ = ["PowerStage"]


@dataclass
class PowerStage:
    """Modes, watchdog and limits of an emulated drive.

    Attributes:
        limits: Limits beyond which it faults.
        watchdog: Time without a command after which it stops [s]; 0 for no watchdog.
        forgiving: Whether it stays enabled without torque when the watchdog expires, and obeys the
            next command; otherwise it faults.
        in_torque_mode: Whether it controls torque; other modes make none here.
        mode: Present mode.
        fault: Reason for which it stopped.
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
        """Present motor torque, link side [N m]."""
        return self._demand if self.mode is Mode.ENABLED and self.in_torque_mode else 0.0

    def boot(self) -> None:
        """Start disabled, without a fault."""
        self.mode, self.fault, self._demand = Mode.DISABLED, None, 0.0

    def enable(self, now: float) -> bool:
        """Switch on with zero torque; return whether that succeeded."""
        if self.mode is Mode.DISABLED:
            self.mode, self._demand, self._heard = Mode.ENABLED, 0.0, now
        return self.mode is Mode.ENABLED

    def disable(self) -> None:
        """Switch off; a fault remains."""
        self._demand = 0.0
        if self.mode is Mode.ENABLED:
            self.mode = Mode.DISABLED

    def fail(self, fault: Fault) -> None:
        """Switch off because of a fault."""
        self.mode, self.fault, self._demand = Mode.FAULT, fault, 0.0

    def clear(self) -> None:
        """Go from a fault to disabled."""
        if self.mode is Mode.FAULT:
            self.mode, self.fault = Mode.DISABLED, None

    def feed(self, now: float) -> None:
        """Feed the watchdog."""
        self._heard = now

    def demand(self, tau_m: float) -> None:
        """Set the torque [N m, link side]; a value that is not finite gives zero."""
        limit = self.limits.tau_m
        self._demand = min(max(tau_m, -limit), limit) if isfinite(tau_m) else 0.0

    def supervise(self, channels: Mapping[str, float], now: float) -> None:
        """Enter a fault if the joint exceeds the limits or the watchdog has expired."""
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
