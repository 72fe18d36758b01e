"""A rotating mass of its own for these tests: plain NumPy, fine steps, friction that holds.

It shares no formula with the project.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cjt_gym.joint import JointFile, load_joint_file
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

DT, FINE = 2e-3, 20
INERTIA, DAMPING, DRY = 0.02, 0.05, 0.12


def datasheet(inertia: float = 2.0, tolerance: float | None = None) -> JointFile:
    """Return the datasheet: inertia off by a factor, a guess or with a tolerance, no friction."""
    values = {"I_m": INERTIA * inertia, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": 1.0}
    bare = JointParameters.from_values("rotor", values)
    stated = Quantity(bare.I_m, "kg m^2", "test", tolerance, guess=tolerance is None)
    return JointFile(bare.replace(I_m=stated))


def right_datasheet(path: Path) -> JointFile:
    """Return a datasheet that is right in all it states, written to a file."""
    path.write_text(f"""
name = "rotor"
source = "test"
structure = "rigid"
[parameters]
n = {{ value = 1.0, unit = "-" }}
k_t = {{ value = 1.0, unit = "N m/A", tolerance = 0.02 }}
I_m = {{ value = {INERTIA}, unit = "kg m^2", tolerance = 0.05 }}
I_g = {{ value = 0.0, unit = "kg m^2" }}
I_l = {{ value = 0.0, unit = "kg m^2" }}
d_m = {{ value = {DAMPING}, unit = "N m s/rad", tolerance = 0.1 }}
[effects.coulomb]
d_cm = {{ value = {DRY}, unit = "N m", tolerance = 0.1 }}
[sensors.q_m]
resolution = {{ value = {2.0 * np.pi / 65536}, unit = "rad" }}
""")
    return load_joint_file(path)


def record(
    seconds: float = 12.0,
    dry: float = DRY,
    noise: float = 0.0,
    seed: int = 0,
    gap: tuple[float, float] | None = None,
    *,
    pushed: bool = False,
    back: tuple[float, float] | None = None,
    late: float = 0.0,
    dt: float = DT,
    shaken: float = 0.0,
    cogged: float = 0.0,
) -> Record:
    """Return a record of the mass under slow and fast torques.

    Args:
        seconds: Its length.
        dry: Coulomb friction [N m].
        noise: Deviation of the measured current [A], which nothing specifies.
        seed: Of torque and noise.
        gap: First and last instant of a stretch that is lost [s].
        pushed: Whether the torque is not the motor's but comes from outside, and is measured.
        late: Time by which the torque acts late, in whole fine steps [s].
        back: Damping [N m s/rad] and Coulomb friction [N m] backward, where they differ.
        dt: Time between two rows [s].
        shaken: Amplitude of a torque of 7.3 Hz that nothing records [N m].
        cogged: Amplitude of a torque that repeats 14 times per revolution [N m].
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds / dt)) * dt
    u = 0.35 * np.sin(2.0 * np.pi * 0.7 * t) + 0.25 * np.sin(2.0 * np.pi * 2.3 * t + 1.0)
    u += rng.uniform(-0.25, 0.25, 200)[(t / 0.3).astype(int) % 200]
    q = v = 0.0
    angle = np.zeros(len(t))
    h = dt / FINE
    acts = np.concatenate([np.zeros(round(late / h)), np.repeat(u, FINE)])
    acts += shaken * np.sin(2.0 * np.pi * 7.3 * h * np.arange(len(acts)))
    for k in range(len(u)):
        angle[k] = q
        for torque in acts[k * FINE : (k + 1) * FINE]:
            damping, level = back if back is not None and v < 0.0 else (DAMPING, dry)
            torque -= cogged * np.sin(14.0 * q)
            free = v + h * (torque - damping * v) / INERTIA
            stop = h * level / INERTIA
            v = free - min(max(free, -stop), stop)
            q += h * v
    step = 2.0 * np.pi / 65536
    columns = {"t": t, "q_m": step * np.round(angle / step), "i": u}
    columns["i"] = u + noise * rng.standard_normal(len(t))
    if pushed:
        columns |= {"tau_l": columns["i"], "i": np.zeros(len(t))}
    keep = np.ones(len(t), dtype=bool)
    if gap is not None:
        keep = (t < gap[0]) | (t > gap[1])
    units = {"t": "s", "q_m": "rad", "i": "A"} | ({"tau_l": "N m"} if pushed else {})
    return Record({n: x[keep] for n, x in columns.items()}, units, structure="rigid")
