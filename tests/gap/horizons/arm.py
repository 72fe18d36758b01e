"""An arm whose slow motion a controller holds, whatever disturbs its torque."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.joint import JointFile, Quantity, get_structure
from cjt_gym.records import Record

ARM = """
name = "arm"
source = "made up"

[parameters]
I_m = { value = 0.5, unit = "kg m^2", source = "guess", tolerance = 0.5 }
I_g = { value = 0.0, unit = "kg m^2", source = "within I_m" }
I_l = { value = 0.0, unit = "kg m^2", source = "none" }
d_m = { value = 0.0, unit = "N m s/rad", source = "not stated" }
n = { value = 100.0, unit = "-", source = "gear" }
k_t = { value = 0.1, unit = "N m/A", source = "datasheet", tolerance = 0.05 }
"""
INERTIA, DAMPING, DRY, WEIGHT = 0.4, 2.0, 4.0, 3.0
DT = 0.01


def held_record(seed: int, disturbance: float = 1.0, cogging: float = 0.0) -> Record:
    """Return slow motion that is followed exactly, whatever disturbs the torque [N m rms].

    Cogging of 60 periods per revolution acts on the motor as a sine over the angle [N m].
    """
    rng = np.random.default_rng(seed)
    t = DT * np.arange(4000)
    w = 2.0 * np.pi * np.array([0.06, 0.13, 0.21, 0.37])
    size, phase = np.array([0.8, 0.3, 0.2, 0.1]), rng.uniform(0.0, 2.0 * np.pi, 4)
    angle = np.outer(t, w) + phase
    q, dq = np.sin(angle) @ size, np.cos(angle) @ (size * w)
    ddq = -np.sin(angle) @ (size * w**2)
    shaken = lfilter([0.6], [1.0, -0.8], rng.standard_normal(len(t))) * disturbance
    torque = INERTIA * ddq + DAMPING * dq + DRY * np.sign(dq) + WEIGHT * np.sin(q) + shaken
    torque -= cogging * np.sin(60.0 * q)
    columns = {"t": t, "q_m": np.round(q / 1e-4) * 1e-4, "i": torque / 10.0}
    return Record(columns, {"t": "s", "q_m": "rad", "i": "A"}, structure="rigid")


def judgement(arm: JointFile, **values: float | Quantity) -> Judgement:
    """Return a judgement of the record, for a datasheet with other values."""
    file = replace(arm, parameters=arm.parameters.replace(**values))
    case = make_case([held_record(0, 0.02)], [], file, get_structure("rigid"))
    return Judgement(case, "found", case.joint, ())
