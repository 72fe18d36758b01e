"""Records of a mass whose motion is prescribed, so that its current follows from its equation."""

from __future__ import annotations

import numpy as np

from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record, default_units

DT = 1e-3
INERTIA, DAMPING, FRICTION, K_T = 0.01, 0.05, 0.2, 0.1
NOISE = {"q_m": 1e-5, "i": 0.02}
BOTH = "both ways, at many speeds"
ONE = "one way"
CREEP = "one way, but for creeping back now and then"
CONSTANT = "both ways, at one speed"
QUICK = "both ways, with quick swings"


def joint(sensors: bool = True, **values: float) -> JointFile:
    """Return the datasheet of the mass."""
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": K_T, **values}
    if not sensors:
        return JointFile(JointParameters.from_values("mass", known))
    stated = {
        "q_m": {"resolution": Quantity(1e-5, "rad"), "noise": Quantity(1e-5, "rad")},
        "i": {"noise": Quantity(NOISE["i"], "A")},
    }
    return JointFile(JointParameters.from_values("mass", known), sensors=stated)


def speed(kind: str, seconds: float) -> Floats:
    """Return the speed of the mass over time [rad/s]."""
    t = np.arange(0.0, seconds, DT)
    if kind == CONSTANT:
        ramp = np.clip(np.sin(np.pi * t) * 20.0, -1.0, 1.0)
        return np.asarray(2.0 * ramp)
    if kind == QUICK:
        return np.asarray(np.sin(5.0 * t) + 0.8 * np.sin(47.0 * t + 1.0) + 0.5 * np.sin(101.0 * t))
    swing = np.sin(1.3 * t) + 0.8 * np.sin(4.1 * t + 1.0) + 0.4 * np.sin(11.0 * t)
    if kind == CREEP:
        return np.where(np.mod(t, 2.0) > 1.84, -0.1, 3.0 + swing)
    return np.asarray(swing if kind == BOTH else 3.0 + swing)


def columns(
    kind: str = BOTH, seconds: float = 8.0, seed: int = 0, dt: float = DT
) -> dict[str, Floats]:
    """Return time, command, current and angle of the mass."""
    rng = np.random.default_rng(seed)
    v = speed(kind, seconds)
    torque = INERTIA * np.gradient(v, DT) + DAMPING * v + FRICTION * np.sign(v)
    t, step = np.arange(len(v)) * DT, round(dt / DT)
    q = np.cumsum(v) * DT + rng.normal(0.0, NOISE["q_m"], len(v))
    i = torque / K_T
    found = {
        "t": t,
        "i_cmd": i,
        "i": i + rng.normal(0.0, NOISE["i"], len(v)),
        "q_m": np.round(q / 1e-5) * 1e-5,
    }
    return {name: x[::step] for name, x in found.items()}


def record(table: dict[str, Floats], structure: str = "rigid") -> Record:
    """Return the record of a table of columns."""
    missing = any(np.isnan(x).any() for x in table.values())
    units = default_units(tuple(table))
    return Record(table, units, structure=structure, allow_nan=missing)
