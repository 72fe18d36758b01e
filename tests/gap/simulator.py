"""A small simulator of its own for the tests of the diagnosis: NumPy, fine steps, sharp friction.

It shares no formula with the project: one drive side with a spring to a wall, or a mass without a
spring, integrated by symplectic Euler, with friction that holds a body at rest.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record, default_units

DT, FINE = 1e-3, 20
TRUE = {"I_m": 0.3, "d_m": 2.0, "k_b": 6000.0, "k_t": 0.08, "n": 80.0, "i_p": 30.0}
TOLERANCE = {"I_m": 0.02, "d_m": 0.1, "k_b": 0.015, "k_t": 0.015}
SENSORS = {
    "q_m": ("rad", 5e-6, 1.5e-6),
    "q_l": ("rad", 5e-6, 1.5e-6),
    "tau": ("N m", 0.02, 0.04),
    "i": ("A", 0.0, 0.015),
}


def nominal(**factors: float) -> JointFile:
    """Return the datasheet; a factor makes a value differ from the true one."""
    values = {k: v * factors.get(k, 1.0) for k, v in TRUE.items()}
    bare = JointParameters.from_values("tested", values)
    toleranced = {
        k: Quantity(bare.quantities[k].value, bare.quantities[k].unit, "test", t)
        for k, t in TOLERANCE.items()
    }
    sensors = {
        channel: {"resolution": Quantity(step, unit), "noise": Quantity(noise, unit)}
        for channel, (unit, step, noise) in SENSORS.items()
    }
    return JointFile(bare.replace(**toleranced), sensors=sensors)


def command(seconds: float, rng: np.random.Generator) -> Floats:
    """Return rest, slow ramps through zero, steps and a chirp [A], shape (N,)."""
    t = np.arange(int(seconds / DT)) * DT
    u = t / seconds
    ramps = 3.0 * (2.0 * np.abs(2.0 * ((3.0 * u) % 1.0) - 1.0) - 1.0)
    steps = rng.uniform(-4.0, 4.0, 200)[(t / 0.15).astype(int) % 200]
    chirp = 3.0 * np.sin(2.0 * np.pi * (1.0 + 12.0 * (t - 0.7 * seconds)) * (t - 0.7 * seconds))
    return np.where(u < 0.05, 0.0, np.where(u < 0.45, ramps, np.where(u < 0.7, steps, chirp)))


def simulate(
    seconds: float = 4.0,
    seed: int = 0,
    friction: tuple[float, float] = (0.0, 0.0),
    breakaway: tuple[float, float] = (0.0, 1.0),
    extra: Callable[[float, float, float], float] | None = None,
    spring: Callable[[float], float] | None = None,
    sensed: Callable[[Floats], Floats] | None = None,
    drive: Callable[[Floats], Floats] | None = None,
) -> Record:
    """Return a record of a drive side that a spring ties to a wall.

    Args:
        seconds: Its length.
        seed: Of command and noise.
        friction: Coulomb levels for both directions [N m].
        breakaway: What rest adds to them [N m], and the velocity over which it fades [rad/s].
        extra: Further torque of time, angle and velocity [N m].
        spring: Torque of deflection [N m]; linear if left out.
        sensed: What the torque sensor makes of the torque.
        drive: What the drive makes of the command.
    """
    rng = np.random.default_rng(seed)
    wanted = command(seconds, rng)
    current = wanted if drive is None else drive(wanted)
    p, h = TRUE, DT / FINE
    q = v = 0.0
    rows = np.zeros((len(wanted), 3))
    for k in range(len(wanted)):
        tau = p["k_b"] * q if spring is None else spring(q)
        rows[k] = q, tau, current[k - 1] if k else 0.0
        for _ in range(FINE):
            tau = p["k_b"] * q if spring is None else spring(q)
            push = p["n"] * p["k_t"] * current[k] - tau - p["d_m"] * v
            if extra is not None:
                push += extra(k * DT, q, v)
            free = v + h * push / p["I_m"]
            rise = breakaway[0] * np.exp(-((v / breakaway[1]) ** 2))
            up, down = (h * (level + rise) / p["I_m"] for level in friction)
            v = free - min(max(free, -down), up)
            q += h * v
    tau = rows[:, 1] if sensed is None else sensed(rows[:, 1])
    true = {"q_m": rows[:, 0], "q_l": np.zeros(len(rows)), "tau": tau, "i": rows[:, 2]}
    columns = {name: _measure(name, x, rng) for name, x in true.items()} | {"i_cmd": wanted}
    units = {name: unit for name, (unit, _, _) in SENSORS.items()} | {"i_cmd": "A"}
    return Record(columns, units, dt=DT, structure="output_fixed_rigid_gearbox")


def only(record: Record, *names: str) -> Record:
    """Return a record of some of its channels alone."""
    columns = {name: record[name] for name in names}
    return Record(columns, default_units(names), dt=record.dt, structure=record.structure)


def _measure(name: str, x: Floats, rng: np.random.Generator) -> Floats:
    _, step, noise = SENSORS[name]
    noisy = x + noise * rng.standard_normal(len(x))
    return step * np.round(noisy / step) if step else noisy
