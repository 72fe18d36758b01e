"""Base of the firmwares of all emulated drives: power stage and periodic reports."""

from __future__ import annotations

from collections.abc import Mapping

from cjt_gym.canbus.protocols.contract import NO_CHANNELS, Fault, Mode, Settings
from cjt_gym.canbus.protocols.power_stage import PowerStage

__all__ = ["Cycles", "StagedFirmware"]


class StagedFirmware:
    """A firmware with the modes, watchdog and limits of a power stage.

    Attributes:
        settings: Settings of the drive.
        stage: Its power stage.
    """

    def __init__(self, settings: Settings, stage: PowerStage | None = None) -> None:
        self.settings = settings
        self.stage = stage or PowerStage(settings.limits, settings.limits.watchdog)
        self._channels: Mapping[str, float] = NO_CHANNELS

    @property
    def mode(self) -> Mode:
        """Present mode."""
        return self.stage.mode

    @property
    def fault(self) -> Fault | None:
        """Reason for which it stopped."""
        return self.stage.fault

    @property
    def torque(self) -> float:
        """Motor torque [N m, link side]."""
        return self.stage.torque

    def fail(self, fault: Fault) -> None:
        """Enter a fault."""
        self.stage.fail(fault)


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
