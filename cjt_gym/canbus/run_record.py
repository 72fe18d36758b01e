"""The record of a run on a bus: which columns it has, what is known of it, a row per step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol, final

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.journal import Journal
from cjt_gym.canbus.sense import Sense
from cjt_gym.canbus.timing import Timing

STAMPS = "reception"
"""Whose clock tells when a frame arrived: the machine's, as it is received."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of what makes a record; the first call takes long."""
    return {name: version(name) for name in ("cjt-gym", "numpy", "python-can")}


class Recorder(Protocol):
    """What takes the rows of a run; see `RunRecord`."""

    path: Path
    rows_path: Path

    def note(
        self,
        k: int,
        measured: Mapping[str, float],
        torque: float,
        tau_ref: float,
        age: float,
        lateness: float,
    ) -> None:
        """Append a row."""
        ...

    def close(self, timing: Timing, **known: Any) -> None:
        """Complete it."""
        ...


BeginRecord = Callable[[HardwareConfig, Sense, float, bool, Mapping[str, Any]], Recorder]
"""Begins a record, from the last five arguments of `RunRecord`."""


@final
class RunRecord:
    """A record that is on disk up to the latest control step.

    Attributes:
        path: Its file.
        rows_path: The file that has its rows until it is complete.
    """

    def __init__(
        self,
        path: str | Path,
        config: HardwareConfig,
        sense: Sense,
        tau_ref: float,
        shows_temperature: bool,
        facts: Mapping[str, Any],
    ) -> None:
        """Begin it.

        Args:
            path: Where it is to be, in any format that records are written in.
            config: The joint on its bus.
            sense: What is measured.
            tau_ref: First joint torque that is wanted [N m], NaN where the run has none.
            shows_temperature: Whether some node reports its temperature.
            facts: What else belongs to its provenance.

        Raises:
            ConfigurationError: The file cannot be written, or the record is there already.
        """
        joint = config.joint
        self._columns, known = self.describe(config, sense, tau_ref, shows_temperature, facts)
        self._per_ampere = joint.parameters.k_t * joint.parameters.n
        self._dt = config.dt
        self._journal = Journal(path, self._columns, config.dt, known)
        self.path, self.rows_path = self._journal.wanted, self._journal.path

    @staticmethod
    def describe(
        config: HardwareConfig,
        sense: Sense,
        tau_ref: float,
        shows_temperature: bool,
        facts: Mapping[str, Any],
    ) -> tuple[list[str], dict[str, Any]]:
        """Return the columns of a record and what is known at its beginning; see `RunRecord`."""
        joint, drive, names = config.joint, config.drive, sense.measured
        columns = ["t", "i_cmd", "tau_cmd", *names, "age", "lateness"]
        if math.isfinite(tau_ref):
            columns.append("tau_ref")
        if shows_temperature:
            columns.append("temperature")
        known = {
            "joint": joint.parameters.name,
            "structure": joint.structure,
            "parameter_hash": joint.file.hash_hex(),
            "versions": versions(),
            "sensors": {n: v for n, v in joint.file.sensors.items() if n in names},
            "provenance": {
                "kind": "hardware",
                "protocol": drive.protocol,
                "node": drive.settings.node,
                "bus": config.bus.identity,
                "torque": sense.torque,
                "stamps": STAMPS,
                **facts,
            },
        }
        return columns, known

    def note(
        self,
        k: int,
        measured: Mapping[str, float],
        torque: float,
        tau_ref: float,
        age: float,
        lateness: float,
    ) -> None:
        """Append a row: what was measured at a deadline, and what was commanded there.

        Args:
            k: Number of the control step.
            measured: Channels of the measurement, by name.
            torque: Motor torque that is commanded [N m].
            tau_ref: Joint torque that is wanted [N m].
            age: Of the motor's angle [s].
            lateness: Of the command behind its deadline [s].
        """
        row = {
            **measured,
            "t": k * self._dt,
            "tau_cmd": torque,
            "i_cmd": torque / self._per_ampere,
            "tau_ref": tau_ref,
            "age": age,
            "lateness": lateness,
        }
        self._journal.write([row[name] for name in self._columns])

    def close(self, timing: Timing, **known: Any) -> None:
        """Complete it with how regular the run was, and whatever else is known."""
        facts = {
            "timing_us": timing.summary(),
            "delays_s": timing.delay(self._dt),
            "randomization": timing.randomization(self._dt),
        }
        self._journal.close(**facts, **known)
