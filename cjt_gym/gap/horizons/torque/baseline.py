"""Least-squares baseline that every diagnosis must at least match."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.horizons.prediction.log import Log, felt_torque
from cjt_gym.gap.horizons.prediction.model import Draft, drafted
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

NOTHING = 1e-6
"""Share of the inertia left to a load that the regression lumps with the motor."""
SHARP = 0.02
"""Velocity over which the regression smooths the sign, relative to the velocity's deviation."""


def least_squares(joint: Joint, logs: Sequence[Log]) -> Joint | None:
    """Return the joint with inertia, damping, Coulomb friction and offset from a regression.

    The motor's torque, less the measured spring torque, is regressed on acceleration, speed, its
    sign and a constant, over all records together. None if a record lacks the angle or a required
    torque, or if that torque never changes.
    """
    parts = [_rows(joint, log) for log in logs]
    if any(part is None for part in parts):
        return None
    v, a, torque = np.concatenate([part for part in parts if part is not None], axis=1)
    if np.ptp(torque) == 0.0:  # as where a joint coasts: every inertia fits
        return None
    width = max(SHARP * float(np.std(v)), 1e-12)
    columns = np.stack([a, v, np.tanh(v / width), np.ones_like(v)], axis=1)
    inertia, damping, dry, offset = np.linalg.lstsq(columns, torque, rcond=None)[0]
    shape, p = joint.structure_row, joint.parameters
    draft = Draft(joint.file, {})
    own = body_group(shape, "m")
    draft.row("inertia")["I_m"] = max(float(inertia), 1e-9)
    if "g" in own:
        draft.effects["inertia"]["I_g"] = 0.0
    if "l" in own and p.get("I_l", 0.0) > 0.0:
        draft.row("load_inertia")["I_l"] = NOTHING * max(float(inertia), 1e-9)
    row = draft.row("damping")
    for body in own:
        row[f"d_{body}"] = 0.0
    row["d_m"] = max(float(damping), 0.0)
    draft.row("coulomb")["d_cm"] = max(float(dry), 0.0)
    draft.smooth(0.0)
    draft.row("torque_offset")["torque"] = -float(offset)
    return drafted(joint, draft)


def _rows(joint: Joint, log: Log) -> Floats | None:
    """Return speed, acceleration and torque of the motor, shape (3, N), if the log has them."""
    p, sprung = joint.parameters, joint.structure_row.has_spring
    if "q_m" not in log.measured or log.voltage or (sprung and "tau" not in log.measured):
        return None
    felt = felt_torque(log.measured["tau"], joint.file) if sprung else -log.load
    torque = p.k_t * p.n * log.command - felt
    return np.stack([log.speed, log.acceleration, torque])[:, log.inside]
