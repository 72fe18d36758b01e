"""The record of a run on a bus: its columns, its metadata, and a row per control step.

The joints of a bus share one record. Where there are several, the name of the joint stands before
each of its columns.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import version
from operator import itemgetter
from pathlib import Path
from typing import Any, final

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.journal import SUFFIX, Journal, Watcher, refuse_taken
from cjt_gym.canbus.measuring import Sense
from cjt_gym.canbus.timing import Timing
from cjt_gym.errors import HardwareError
from cjt_gym.records import JOINT_FILE
from cjt_gym.records.columns import JOINT_MARK

COMMANDS = ("i_cmd", "tau_cmd")


@cache
def versions() -> dict[str, str]:
    """Return the versions of the software that makes a record; the first call is slow."""
    return {name: version(name) for name in ("cjt-gym", "numpy", "python-can")}


@final
class RunRecord:
    """A record on disk that starts once all joints have started, and ends once all have ended.

    Attributes:
        path: Its file.
    """

    def __init__(
        self, path: str | Path, joints: int, dt: float, watcher: Watcher | None = None
    ) -> None:
        """Prepare the record; the file is created when the last joint starts."""
        self.path = Path(path)
        refuse_taken(self.path)
        self._joints, self._dt, self._watcher = joints, dt, watcher
        self._parts: list[JointRecord] = []
        self._journal: Journal | None = None
        self._ended: dict[str, Mapping[str, Any]] = {}

    def begin(self, part: JointRecord) -> None:
        """Add the columns of a joint."""
        self._parts.append(part)
        if len(self._parts) == self._joints:
            columns = ["t", *(self._named(p, name) for p in self._parts for name in p.columns)]
            known = part.known if self._joints == 1 else self._known()
            self._journal = Journal(self.path, columns, self._dt, known, self._watcher)

    def _named(self, part: JointRecord, name: str) -> str:
        return name if self._joints == 1 else f"{part.name}{JOINT_MARK}{name}"

    def _known(self) -> dict[str, Any]:
        joints: dict[str, Any] = {}
        sensors: dict[str, Any] = {}
        for part in self._parts:
            known = part.known
            sensors |= {self._named(part, n): v for n, v in known["sensors"].items()}
            own = {k: known[k] for k in ("joint", "structure", "parameter_hash")}
            joints[part.name] = own | known["provenance"]
        provenance = {"kind": "hardware", "joints": joints}
        return {"versions": versions(), "sensors": sensors, "provenance": provenance}

    def fill(self, is_last: bool = False) -> None:
        """Write the rows that all joints have; at the end, also those that only some have."""
        if self._journal is None or not (is_last or self._parts[-1].rows):
            return
        enough = any if is_last else all
        while enough(part.rows for part in self._parts):
            values = [value for part in self._parts for value in part.take()]
            self._journal.write([self._journal.rows * self._dt, *values])

    def end(self, name: str, timing: Timing, known: Mapping[str, Any]) -> None:
        """Mark a joint as ended; the last one completes the record."""
        facts = {
            "timing_us": timing.summary(),
            "delays_s": timing.delay(self._dt),
            "randomization": timing.randomization(self._dt),
            **known,
        }
        self._ended.setdefault(name, facts)
        if len(self._ended) < self._joints or self._journal is None:
            return
        with contextlib.suppress(OSError):  # the disk is full: what is there is completed
            self.fill(is_last=True)
        self._journal.close(**(facts if self._joints == 1 else self._together()))

    def _together(self) -> dict[str, Any]:
        """Return how several joints ended; a fault is that of the joint which failed first."""
        known: dict[str, Any] = {
            "timing_us": next(iter(self._ended.values()))["timing_us"],
            "delays_s": {n: f["delays_s"] for n, f in self._ended.items()},
        }
        faults = [(n, f["fault"]) for n, f in self._ended.items() if "fault" in f]
        own = [(n, f) for n, f in faults if f["kind"] != "neighbour"] or faults
        if own:
            known["fault"] = {"joint": own[0][0], **own[0][1]}
        return known


@final
class JointRecord:
    """The part of a joint in the record of its first run, if there is one.

    Attributes:
        name: Name of the joint where there are several.
        columns: Its columns, without the time.
        known: Its metadata at the start.
        rows: Rows that wait for those of other joints.
    """

    def __init__(self, config: HardwareConfig, sense: Sense, record: RunRecord | None) -> None:
        """Prepare; `begin` starts it."""
        versions()
        self.name = config.name
        self.columns: list[str] = []
        self.known: dict[str, Any] = {}
        self.rows: deque[Sequence[float]] = deque()
        self._config, self._sense, self._record = config, sense, record
        p = config.joint.parameters
        self._per_ampere = p.k_t * p.n
        self._facts: dict[str, Any] = {}
        self._last: Sequence[float] = ()

    def know(self, **facts: Any) -> None:
        """Add facts to the provenance of a record that has not started yet."""
        self._facts |= facts

    def begin(self, tau_ref: float, shows_temperature: bool, stamps: str) -> None:
        """Start the record.

        Args:
            tau_ref: First reference torque [N m]; NaN if the run has none.
            shows_temperature: Whether a node reports its temperature.
            stamps: Clock of the arrival times.
        """
        if self._record is None or self.columns:
            return
        optional = {"tau_ref": math.isfinite(tau_ref), "temperature": shows_temperature}
        columns = ["i_cmd", "tau_cmd", *self._sense.measured, "age", "lateness", "round_trip"]
        self.columns = columns + [name for name, there in optional.items() if there]
        self._last = (0.0,) * len(self.columns)
        self._picked = itemgetter(*self.columns)
        self.known = self._beginning(stamps)
        self._record.begin(self)

    def _beginning(self, stamps: str) -> dict[str, Any]:
        joint, drive, names = self._config.joint, self._config.drive, self._sense.measured
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
                "bus": self._config.bus.identity,
                "torque": self._sense.torque,
                "stamps": stamps,
                "soft_s": self._config.soft,
                **self._facts,
            },
        }

    def note(self, measured: Mapping[str, float], **others: float) -> None:
        """Take a row, which is written once all joints have theirs.

        Args:
            measured: Channels of the measurement, by name.
            **others: The other columns, but for the current that is commanded.
        """
        if self._record is None or not self.columns:
            return
        row = {**measured, **others, "i_cmd": others["tau_cmd"] / self._per_ampere}
        self.rows.append(self._picked(row))
        self._record.fill()

    def take(self) -> Sequence[float]:
        """Return the next row; beyond the end, the last one with zero torque."""
        if self.rows:
            self._last = self.rows.popleft()
            return self._last
        return [
            0.0 if name in COMMANDS else value
            for name, value in zip(self.columns, self._last, strict=True)
        ]

    def end(self, timing: Timing, **known: Any) -> None:
        """Complete the record with the timing of the run and further facts."""
        if self._record is None or not self.columns:
            return
        record, self._record = self._record, None
        try:
            record.end(self.name, timing, known)
        except OSError as error:
            raise HardwareError(
                f"The record {record.path} could not be completed: {error}. Its rows are there, "
                f"as far as they were written, in {record.path.with_suffix(SUFFIX)}."
            ) from error
