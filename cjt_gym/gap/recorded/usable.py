"""Whether records can be diagnosed together, and what of them was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cjt_gym.errors import ConfigurationError
from cjt_gym.gap.digits import plain
from cjt_gym.gap.recorded.noise import lattice_step
from cjt_gym.records import FloatArray, Record

COPIES = (("i", "i_cmd"), ("tau_m", "tau_cmd"))
"""Measurements and the commands that some logs write in their place."""
SAME = 1e-3
"""Largest difference between the two, relative to the command's range: other units round."""
EACH_STEP = 0.1
"""Largest difference between a torque and a multiple of the deflection, relative to what one step
of an encoder is in it. A torque sensor does not feel those steps."""
OPPOSED = 0.02
"""Largest relative difference between the multiples of the two angles of a deflection."""


def unmeasured(record: Record) -> dict[str, tuple[str, str]]:
    """Return the columns that stand for no measurement, each with what counts alone, and why.

    Some logs repeat the command in their place, or hold a value that never changes. A joint torque
    that is computed from the spring's deflection tells nothing beyond the angles.
    """
    found: dict[str, tuple[str, str]] = {}
    for name, command in COPIES:
        if name in record and command in record:
            said = _in_place_of(record[name], record[command])
            found |= {name: (command, said.format(command))} if said else {}
    stiffness = _computed_with(record)
    if stiffness is not None:
        unit = f"{record.units['tau']}/{record.units['q_m']}"
        said = f"is {plain(stiffness)} {unit} times the deflection, with each step of an encoder"
        found["tau"] = "the deflection", said
    return found


def _computed_with(record: Record) -> float | None:
    """Return the stiffness by which a joint torque was computed from the deflection, if it was."""
    names = [name for name in ("tau", "q_m", "q_l") if name in record]
    if names[:2] != ["tau", "q_m"]:
        return None
    known = np.all([np.isfinite(record[name]) for name in names], axis=0)
    tau, turned, *held = (record[name][known] for name in names)
    angles = [turned, *(q for q in held if len(q) and np.ptp(q) > 0.0)]  # a locked output may rest
    if len(tau) <= len(angles) or np.ptp(turned) <= 0.0:
        return None
    matrix = np.column_stack([*angles, np.ones(len(tau))])
    slopes = np.linalg.lstsq(matrix, tau, rcond=None)[0]
    if len(angles) == 2 and abs(slopes[0] + slopes[1]) > OPPOSED * abs(slopes[0]):
        return None
    step = max(abs(k) * lattice_step(q) for k, q in zip(slopes, angles, strict=False))
    left = float(np.std(tau - matrix @ slopes))
    return float(abs(slopes[0])) if left < EACH_STEP * step else None


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
