"""One record for several joints, with the joint's name before each column."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

from cjt_gym.canbus.journal import Journal, Watcher
from cjt_gym.canbus.run_record import Beginning, Sample, versions
from cjt_gym.canbus.timing import Timing
from cjt_gym.records.columns import JOINT_MARK

SHARED = ("t",)
COMMANDS = ("i_cmd", "tau_cmd")


@final
class ArmRecord:
    """A record that starts once all joints have started, and ends once all have ended.

    Attributes:
        path: Its file.
        rows_path: File that holds its rows until it is complete.
        dt: Control step [s].
    """

    def __init__(
        self, path: str | Path, joints: int, dt: float, watcher: Watcher | None = None
    ) -> None:
        """Prepare the record; the file is created when the last joint starts."""
        self.path = self.rows_path = Path(path)
        self._joints, self.dt, self._watcher = joints, dt, watcher
        self._parts: list[JointRows] = []
        self._journal: Journal | None = None
        self._rows = 0
        self._closed: dict[str, Any] = {}

    def begin(self, beginning: Beginning) -> JointRows:
        """Start the columns of a joint."""
        part = JointRows(self, beginning)
        self._parts.append(part)
        if len(self._parts) == self._joints:
            self._open()
        return part

    def _open(self) -> None:
        columns = [*SHARED, *(name for part in self._parts for name in part.columns)]
        sensors = {k: v for part in self._parts for k, v in part.sensors.items()}
        joints = {part.name: part.facts for part in self._parts}
        facts = {
            "versions": versions(),
            "sensors": sensors,
            "provenance": {"kind": "hardware", "joints": joints},
        }
        self._journal = Journal(self.path, columns, self.dt, facts, self._watcher)
        self.path, self.rows_path = self._journal.wanted, self._journal.path

    def fill(self, is_last: bool = False) -> None:
        """Write the rows that all joints have; at the end, also those that only some have."""
        if self._journal is None:
            return
        enough = any if is_last else all
        while enough(part.rows for part in self._parts):
            values = [value for part in self._parts for value in part.take()]
            self._journal.write([self._rows * self.dt, *values])
            self._rows += 1

    def end(self, name: str, facts: Mapping[str, Any]) -> None:
        """Mark a joint as ended; the last one completes the record."""
        self._closed.setdefault(name, facts)
        if len(self._closed) < self._joints or self._journal is None:
            return
        faults = [(n, f["fault"]) for n, f in self._closed.items() if "fault" in f]
        known: dict[str, Any] = {
            "timing_us": next(iter(self._closed.values()))["timing_us"],
            "delays_s": {n: f["delays_s"] for n, f in self._closed.items()},
        }
        own = [(n, f) for n, f in faults if f["kind"] != "neighbour"] or faults
        if own:
            known["fault"] = {"joint": own[0][0], **own[0][1]}
        with contextlib.suppress(OSError):  # the disk is full: what is there is completed
            self.fill(is_last=True)
        self._journal.close(**known)


@final
class JointRows:
    """The columns of one joint; takes rows as `RunRecord` does."""

    def __init__(self, whole: ArmRecord, beginning: Beginning) -> None:
        self._whole, self._beginning = whole, beginning
        self.name = beginning.config.name
        self.path, self.rows_path = whole.path, whole.rows_path
        known = beginning.known
        self._plain = [name for name in beginning.columns if name not in SHARED]
        self.columns = [f"{self.name}{JOINT_MARK}{name}" for name in self._plain]
        self.sensors = {f"{self.name}{JOINT_MARK}{n}": v for n, v in known["sensors"].items()}
        self.facts = {k: known[k] for k in ("joint", "structure", "parameter_hash")}
        self.facts |= known["provenance"]
        self.rows: deque[list[float]] = deque()
        self._last = [0.0] * len(self._plain)

    def note(self, sample: Sample) -> None:
        """Take a row, which is written once all joints have theirs."""
        row = self._beginning.row(sample)
        self.rows.append([row[name] for name in self._plain])
        self._whole.fill()

    def take(self) -> list[float]:
        """Return the next row; beyond the end, the last one with zero torque."""
        if self.rows:
            self._last = self.rows.popleft()
            return self._last
        return [
            0.0 if name in COMMANDS else value
            for name, value in zip(self._plain, self._last, strict=True)
        ]

    def close(self, timing: Timing, **known: Any) -> None:
        """End the columns of this joint."""
        facts = {"timing_us": timing.summary(), "delays_s": timing.delay(self._whole.dt)}
        self._whole.end(self.name, {**facts, **known})
