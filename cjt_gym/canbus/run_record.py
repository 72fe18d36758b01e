"""The record of a run on a bus: its columns, its metadata, and a row per control step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Protocol, final

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.journal import Journal, Watcher
from cjt_gym.canbus.measuring import Sense
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import HardwareError
from cjt_gym.records import JOINT_FILE


@cache
def versions() -> dict[str, str]:
    """Return the versions of the software that makes a record; the first call is slow."""
    return {name: version(name) for name in ("cjt-gym", "numpy", "python-can")}


class Sample(NamedTuple):
    """Measurement and command at a deadline.

    Attributes:
        k: Number of the control step.
        measured: Channels of the measurement, by name.
        torque: Commanded motor torque [N m].
        tau_ref: Reference torque [N m].
        age: Age of the motor's angle [s].
        lateness: Lateness of the command [s].
        round_trip: Time from the previous command to the first report after it [s]; 0 without one.
    """

    k: int
    measured: Mapping[str, float]
    torque: float
    tau_ref: float
    age: float
    lateness: float
    round_trip: float


@dataclass(frozen=True)
class Beginning:
    """What is known of a joint when its record starts.

    Attributes:
        config: Configuration of the joint.
        sense: Completes what is measured.
        tau_ref: First reference torque [N m]; NaN if the run has none.
        shows_temperature: Whether a node reports its temperature.
        stamps: Clock of the arrival times.
        facts: Further entries of its provenance.
    """

    config: HardwareConfig
    sense: Sense
    tau_ref: float
    shows_temperature: bool
    stamps: str
    facts: Mapping[str, Any]

    @property
    def columns(self) -> list[str]:
        """The columns."""
        optional = {"tau_ref": math.isfinite(self.tau_ref), "temperature": self.shows_temperature}
        columns = ["t", "i_cmd", "tau_cmd", *self.sense.measured, "age", "lateness", "round_trip"]
        return columns + [name for name, there in optional.items() if there]

    @property
    def known(self) -> dict[str, Any]:
        """Metadata at the start."""
        joint, drive, names = self.config.joint, self.config.drive, self.sense.measured
        file = {} if joint.file.path is None else {JOINT_FILE: str(joint.file.path)}
        return {
            "joint": joint.parameters.name,
            "structure": joint.structure,
            "parameter_hash": joint.file.hash_hex(),
            "versions": versions(),
            "sensors": {n: v for n, v in joint.file.sensors.items() if n in names},
            "provenance": {
                "kind": "hardware",
                **file,
                "protocol": drive.protocol,
                "node": drive.settings.node,
                "bus": self.config.bus.identity,
                "torque": self.sense.torque,
                "stamps": self.stamps,
                **self.facts,
            },
        }

    def row(self, sample: Sample) -> dict[str, float]:
        """Return the values of a sample by column."""
        p = self.config.joint.parameters
        return {
            **sample.measured,
            "t": sample.k * self.config.dt,
            "tau_cmd": sample.torque,
            "i_cmd": sample.torque / (p.k_t * p.n),
            "tau_ref": sample.tau_ref,
            "age": sample.age,
            "lateness": sample.lateness,
            "round_trip": sample.round_trip,
        }


class Recorder(Protocol):
    """Interface of what takes the samples of a run.

    Attributes:
        path: Its file.
        rows_path: File that holds its rows until it is complete.
    """

    path: Path
    rows_path: Path

    def note(self, sample: Sample) -> None:
        """Append a row."""

    def close(self, timing: Timing, **known: Any) -> None:
        """Complete it with the timing of the run and further facts."""


BeginRecord = Callable[[Beginning], Recorder]
"""Begins a record."""


@final
class RunLog:
    """The record of a joint's first run, if any; see `Recorder`."""

    def __init__(self, config: HardwareConfig, sense: Sense, begin: BeginRecord | None) -> None:
        """Prepare the record."""
        versions()
        self._config, self._sense, self._begin = config, sense, begin
        self._facts: dict[str, Any] = {}
        self._record: Recorder | None = None

    def know(self, **facts: Any) -> None:
        """Add facts to the provenance of a record that has not started yet."""
        self._facts |= facts

    def begin(self, tau_ref: float, shows_temperature: bool, stamps: str) -> None:
        """Start the record; see `Beginning`."""
        if self._begin is not None and self._record is None:
            self._record = self._begin(
                Beginning(
                    self._config, self._sense, tau_ref, shows_temperature, stamps, self._facts
                )
            )

    def note(self, sample: Sample) -> None:
        """Append a row."""
        if self._record is not None:
            self._record.note(sample)

    def end(self, timing: Timing, **known: Any) -> None:
        """Complete the record."""
        if self._record is None:
            return
        record, self._record, self._begin = self._record, None, None
        try:
            record.close(timing, **known)
        except OSError as error:
            raise HardwareError(
                f"The record {record.path} could not be completed: {error}. Its rows are there, "
                f"as far as they were written, in {record.rows_path}."
            ) from error


@final
class RunRecord:
    """A record on disk, up to date with the latest control step; see `Recorder`."""

    def __init__(
        self, path: str | Path, beginning: Beginning, watcher: Watcher | None = None
    ) -> None:
        """Start the record."""
        self._beginning, self._columns = beginning, beginning.columns
        self._dt = beginning.config.dt
        self._journal = Journal(path, self._columns, self._dt, beginning.known, watcher)
        self.path, self.rows_path = self._journal.wanted, self._journal.path

    def note(self, sample: Sample) -> None:
        """Append a row."""
        row = self._beginning.row(sample)
        self._journal.write([row[name] for name in self._columns])

    def close(self, timing: Timing, **known: Any) -> None:
        """Complete it with the timing of the run and further facts."""
        facts = {
            "timing_us": timing.summary(),
            "delays_s": timing.delay(self._dt),
            "randomization": timing.randomization(self._dt),
        }
        self._journal.close(**facts, **known)
