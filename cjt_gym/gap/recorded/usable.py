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


def unmeasured(record: Record) -> dict[str, tuple[str, str]]:
    """Return the columns that stand for no measurement, each with its command and what it does.

    Some logs repeat the command in their place, or hold a value that never changes.
    """
    found: dict[str, tuple[str, str]] = {}
    for name, command in COPIES:
        if name in record and command in record:
            said = _in_place_of(record[name], record[command])
            found |= {name: (command, said.format(command))} if said else {}
    return found


def _in_place_of(x: FloatArray, command: FloatArray) -> str:
    """Return what a column does in place of a measurement, or "" if it may be one."""
    known = np.isfinite(command) & np.isfinite(x)
    span = np.ptp(command[known]) if known.any() else 0.0
    if span <= 0.0:
        return ""
    if np.abs(x - command)[known].max() < SAME * span:
        return "repeats {} in every row"
    return "never changes while {} does" if np.nanmax(x) == np.nanmin(x) else ""


def measured_only(records: Sequence[Record]) -> list[Record]:
    """Return records without columns that stand for no measurement."""
    found = []
    for record in records:
        if others := unmeasured(record):
            columns = {name: record[name] for name in record.columns if name not in others}
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
