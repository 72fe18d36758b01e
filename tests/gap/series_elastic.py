"""A series-elastic joint, simulated by the classical Runge-Kutta method, and its bare joint file.

It shares no code with the package: friction is a steep tanh, the drive a lag of first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cjt_gym.joint import JointFile, load_joint_file
from cjt_gym.records import Record, default_units

SHEET = """
name = "bare"
source = "datasheets of motor and spring"

[parameters]
n = { value = 50, unit = "-" }
k_t = { value = 0.06, unit = "N m/A" }
I_m = { value = 0.12, unit = "kg m^2" }
I_g = { value = 0.001, unit = "kg m^2", guess = true }
I_l = { value = 0.4, unit = "kg m^2", guess = true }
k_b = { value = 300, unit = "N m/rad" }
"""
FREE, FIXED = "rigid_gearbox", "output_fixed_rigid_gearbox"
DT, SAMPLES, SUBSTEPS, LAG, STEP = 1e-3, 8000, 5, 1e-3, 2e-5
NOISE = {"i": 0.02, "tau": 0.03}
SHARP = 0.003
"""Velocity over which the sign of dry friction turns round [rad/s]."""


@dataclass(frozen=True)
class Arm:
    """What the joint is. Cogging acts as a sine of 25 times the motor's angle."""

    inertia: float = 0.121
    load: float = 0.5
    stiffness: float = 300.0
    damping: float = 0.4  # of the spring
    d_m: float = 0.6
    d_l: float = 0.05
    dry: float = 0.8
    dry_load: float = 0.0
    weight: float = 0.0
    hard: float = 0.0  # cubic stiffness over linear stiffness [1/rad^2]
    cogging: float = 0.0
    step: float = STEP  # of both encoders [rad]


def sheet(folder: Path) -> JointFile:
    path = folder / "bare.toml"
    path.write_text(SHEET)
    return load_joint_file(str(path))


def log(structure: str, arm: Arm = Arm(), seed: int = 0) -> Record:
    """Return command, current, angles and torque of a joint."""
    free, rng, t = structure == FREE, np.random.default_rng(seed), DT * np.arange(SAMPLES)
    command = sum(
        3.0 / (1.0 + 0.2 * f) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28))
        for f in (0.3, 0.7, 1.3, 2.1, 3.7, 5.3, 8.0)
    )

    def spring(q: float, v: float, q_l: float, v_l: float) -> float:
        x = q - q_l
        return arm.stiffness * x * (1.0 + arm.hard * x * x) + arm.damping * (v - v_l)

    def slope(x: tuple[float, ...], wanted: float) -> tuple[float, ...]:
        q, v, q_l, v_l, i = x
        bar = spring(q, v, q_l, v_l)
        own = 3.0 * i - bar - arm.d_m * v - arm.dry * np.tanh(v / SHARP)
        own -= arm.cogging * np.sin(25.0 * q)
        rest = bar - arm.d_l * v_l - arm.dry_load * np.tanh(v_l / SHARP)
        rest -= arm.weight * np.sin(q_l)
        return v, own / arm.inertia, v_l, rest / arm.load if free else 0.0, (wanted - i) / LAG

    def moved(x: tuple[float, ...], k: tuple[float, ...], h: float) -> tuple[float, ...]:
        return tuple(a + h * b for a, b in zip(x, k, strict=True))

    states, x, h = np.zeros((SAMPLES, 5)), (0.0,) * 5, DT / SUBSTEPS
    for n, wanted in enumerate(command):
        states[n] = x
        for _ in range(SUBSTEPS):
            k1 = slope(x, wanted)
            k2 = slope(moved(x, k1, 0.5 * h), wanted)
            k3 = slope(moved(x, k2, 0.5 * h), wanted)
            k4 = slope(moved(x, k3, h), wanted)
            x = tuple(
                a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e)
                for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
            )
    q, v, q_l, v_l, i = states.T
    columns = {"t": t, "i_cmd": command, "i": i, "q_m": arm.step * np.round(q / arm.step)}
    if free:
        columns["q_l"] = arm.step * np.round(q_l / arm.step)
    columns["tau"] = spring(q, v, q_l, v_l)
    for name, deviation in NOISE.items():
        columns[name] = columns[name] + deviation * rng.standard_normal(SAMPLES)
    return Record(columns, default_units(tuple(columns)), structure=structure)


def without(record: Record, *names: str) -> Record:
    """Return a record without some of its columns."""
    columns = {n: record[n] for n in record.columns if n not in names}
    return Record(columns, default_units(tuple(columns)), structure=record.structure)
