"""Whether records can be diagnosed together, and what of them was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cjt_gym.errors import ConfigurationError
from cjt_gym.records import FloatArray, Record

COPIES = (("i", "i_cmd"), ("tau_m", "tau_cmd"))
"""Measurements and the commands that some logs write in their place."""
SAME = 1e-3
"""Largest difference between the two, relative to the command's range: other units round."""


def copies(record: Record) -> dict[str, str]:
    """Return the columns that repeat a command in every row, each with that command."""
    return {
        name: command
        for name, command in COPIES
        if name in record and command in record and _repeats(record[name], record[command])
    }


def _repeats(x: FloatArray, command: FloatArray) -> bool:
    known = np.isfinite(command)
    span = np.ptp(command[known]) if known.any() else 0.0
    return bool(span > 0.0 and np.abs(x - command)[known].max() < SAME * span)


def measured_only(records: Sequence[Record]) -> list[Record]:
    """Return records without columns that repeat a command in every row."""
    found = []
    for record in records:
        if copied := copies(record):
            columns = {name: record[name] for name in record.columns if name not in copied}
            units = {name: unit for name, unit in record.units.items() if name in columns}
            sensors = {name: known for name, known in record.sensors.items() if name in columns}
            record = replace(record, columns=columns, units=units, sensors=sensors)
        found.append(record)
    return found


def check_one_joint(records: Sequence[Record]) -> None:
    """Raise ConfigurationError where records name different joints."""
    files = {str(r.joint_file): r.owner for r in records if r.joint_file is not None}
    contents = {Path(f).read_bytes() if Path(f).is_file() else f for f in files}
    if len(contents) > 1:
        (one, its), (other, theirs), *_ = files.items()
        raise ConfigurationError(
            f"The records must be of one joint, but {its} names {one} and {theirs} names {other}. "
            "Diagnose them apart, or give the joint that all of them share (--joint)."
        )
