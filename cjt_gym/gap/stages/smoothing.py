"""How dry friction passes through zero speed where a joint file does not say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.recorded.series import Stretch
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.recorded.tolerances import SMOOTHING
from cjt_gym.gap.stages.explain import without_effects
from cjt_gym.joint import EFFECTS, JointFile, Structure
from cjt_gym.joint.effects.motor import DQ_0
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.files.quantity import Quantity

SMOOTHED = float(DQ_0.default or 0.0)
"""Velocity over which simulations smooth dry friction where no file says [rad/s]."""


def with_smoothing(file: JointFile, shape: Structure, whole: Sequence[Stretch]) -> JointFile:
    """Return a joint file that says how its dry friction passes through zero speed.

    Real friction sticks. A file that states a level of friction but no velocity over which its sign
    is smoothed is taken to mean that, unless the records agree better with the smoothing that
    simulations have by default.
    """
    known = ((EFFECTS[name], EFFECTS[name].parameter(SMOOTHING)) for name in file.effects)
    rows = [(row, parameter) for row, parameter in known if parameter is not None]
    if not rows or any(SMOOTHING in file.effects[row.name] for row, _ in rows):
        return file
    unit = unit_on(rows[0][1], file.parameters)
    sharp = Quantity(0.0, unit, "not stated: dry friction sticks")
    entries = {row.name: {**file.effects[row.name], SMOOTHING: sharp} for row, _ in rows}
    sticking = replace(file, effects={**file.effects, **entries})
    try:
        setting = make_setting(whole[0].record, sticking, shape, None, whole[0].log)
        problem, base = without_effects(setting, ())
    except (np.linalg.LinAlgError, FloatingPointError, ValueError):
        return sticking
    fields = problem.fields(base.model, base.z)
    smoothed = fields | {f"dq_0_{body}": SMOOTHED for body in "mgl"}
    dry, smooth = (problem.stages.residual("motor", one) for one in (fields, smoothed))
    return file if float(smooth @ smooth) < float(dry @ dry) else sticking
