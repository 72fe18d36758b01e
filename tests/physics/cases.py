"""What the physics tests share: states, stored energy, random valid joints, one excitation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from cjt_gym.joint import STRUCTURES, Effect, Joint, joint_names, load_joint, load_joint_file
from cjt_gym.joint.batch import JointBatch
from cjt_gym.joint.configure import typical_value
from cjt_gym.joint.kernel.arrays import BRISTLE, LOOP
from cjt_gym.joint.kernel.spring_table import spring_rows
from cjt_gym.records import Record

Floats = NDArray[np.float64]
Effects = dict[str, dict[str, Any]]
STATES = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l")
FIXED = tuple(name for name, row in STRUCTURES.items() if row.output_fixed)
FREE = tuple(name for name in STRUCTURES if name not in FIXED)
DT = 1e-3
EPS = float(np.finfo(np.float64).eps)
UNDAMPED = dict.fromkeys((f"d_{key}{way}" for key in "mgl" for way in ("", "_n")), 0.0)
LOSSLESS = UNDAMPED | {"d_mg": 0.0, "d_gl": 0.0, "I_l": 0.5}


def lossless(structure: str, effects: Effects, **parameters: float) -> Joint:
    """Return a joint that takes no energy but by its effects."""
    values = LOSSLESS | parameters
    return load_joint("orange_80_6000", structure, effects=effects, parameters=values)


def typical(effect: Effect) -> dict[str, Any]:
    """Return the values with which `effects="all"` turns an effect on."""
    p = load_joint_file("orange_80_6000").parameters
    return {parameter.symbol: typical_value(parameter, p) for parameter in effect.parameters}


def states(record: Record) -> Floats:
    """Return the true states of a record, shape (samples, 6) [rad, rad/s]."""
    return np.column_stack([record[f"true_{name}"] for name in STATES])


def falls(x: Floats, h: float) -> Floats:
    """Return the times at which a signal falls through zero, from samples h apart."""
    down = np.flatnonzero((x[:-1] > 0.0) & (x[1:] <= 0.0))
    return np.asarray((down + x[down] / (x[down] - x[down + 1])) * h)


def stiffness_number(joint: Joint, h: float) -> float:
    """Return a bound on (omega h)**2 for the fastest mode."""
    p = joint.parameters
    return float(2.0 * h**2 * (p.k_g + p.k_b) / min(p.I_m, p.I_g, p.I_l))


def log_range(low: float, high: float) -> st.SearchStrategy[float]:
    """Return floats between low and high, evenly spread over the orders of magnitude."""
    return st.floats(np.log10(low), np.log10(high)).map(lambda x: float(10.0**x))


def maybe(strategy: st.SearchStrategy[float]) -> st.SearchStrategy[float]:
    """Return zero or a draw."""
    return st.just(0.0) | strategy


@st.composite
def valid_parameters(draw: st.DrawFn) -> dict[str, float]:
    """Return parameters that replace those of `generic`; I_l = 1e-4 and no damping included."""
    drawn = {
        "I_m": draw(log_range(0.01, 2.0)),
        "I_g": draw(log_range(0.01, 1.0)),
        "I_l": draw(st.just(1e-4) | log_range(1e-4, 1.0)),
        "k_g": draw(log_range(1e3, 5e4)),
        "k_b": draw(log_range(1e3, 5e4)),
        "d_mg": draw(maybe(log_range(0.1, 400.0))),
        "d_gl": draw(maybe(log_range(0.1, 400.0))),
    }
    for symbol in ("d_m", "d_g", "d_l"):
        drawn[symbol] = drawn[f"{symbol}_n"] = draw(maybe(log_range(1e-3, 20.0)))
    return drawn


@st.composite
def friction_effects(draw: st.DrawFn, sharp: bool = True) -> Effects:
    """Return friction with unequal levels, from sharp to smooth, or none."""
    effects: Effects = {}
    if draw(st.booleans()):
        levels = [f"d_c{body}{way}" for body in "mgl" for way in ("", "_n")]
        values: dict[str, Any] = {name: draw(maybe(log_range(0.1, 10.0))) for name in levels}
        values["d_cm"] = draw(log_range(0.1, 10.0))
        smooth = log_range(1e-4, 0.05)
        values["dq_0"] = draw(maybe(smooth) if sharp else smooth)
        effects["coulomb_asym"] = values
    if draw(st.booleans()):
        effects["viscous_asym"] = {f"d_{body}_n": draw(log_range(1e-3, 40.0)) for body in "mgl"}
    return effects


def initial_state(seed: int) -> Floats:
    """Return a random state: deflections of a twentieth of a radian, speeds of 1 rad/s."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(0.0, 0.05, 3), rng.normal(0.0, 1.0, 3)])


def smooth_effects(name: str, *, ripple_by_torque: bool = False) -> Effects:
    """Return friction and ripple at the joint's own levels, each in every form that is smooth."""
    p = load_joint_file(name).parameters
    per_turn = p.n if p.n > 1.0 else 50.0
    effects: Effects = {
        "coulomb": {"d_cm": p.get("d_cm", 20.0), "dq_0": 0.002},
        "viscous_asym": {"d_m_n": p.get("d_m", 0.0) + 1.0, "d_g_n": p.get("d_g", 0.0) + 0.5},
        "cogging": {"f": (per_turn, 6 * per_turn), "a": (0.3, 0.1), "b": (-0.2, 0.15)},
    }
    if ripple_by_torque:
        effects["gear_ripple"] = {"f": (2 * per_turn,), "a": (0.02,), "b": (0.03,)}
    return effects


def excitation(joint: Joint, samples: int) -> tuple[Floats, Floats]:
    """Return motor torque [N m] and load [N m or rad/s] that reverse the motion several times."""
    t = np.arange(samples) * DT
    peak = min(joint.torque_limit, 200.0)
    tau_m = peak * (0.35 * np.sin(2 * np.pi * 2.3 * t) + 0.2 * np.sin(2 * np.pi * 17.0 * t + 1.0))
    if joint.structure_row.output_fixed:
        return tau_m, 0.5 * np.sin(2 * np.pi * 1.7 * t)
    return tau_m, 0.1 * peak * np.sin(2 * np.pi * 5.0 * t)


def known_grid() -> list[tuple[str, str]]:
    """Return every shipped joint with each structure whose springs are known of it."""
    found = []
    for name in joint_names():
        known = load_joint_file(name).parameters
        for structure, row in STRUCTURES.items():
            motor, gear, load = row.groups
            if (motor == gear or "k_g" in known) and (gear == load or "k_b" in known):
                found.append((name, structure))
    return found


@dataclass(frozen=True)
class Trace:
    """A joint at the start and after every control step.

    Attributes:
        x: [q_m q_g q_l dq_m dq_g dq_l] [rad, rad/s], shape (steps + 1, 6).
        memory: What its effects remember, shape (steps + 1, MEMORY).
        currents: [i_q, i_d] [A], shape (steps + 1, 2).
        energy: Kinetic and stored energy [J], shape (steps + 1,).
    """

    x: Floats
    memory: Floats
    currents: Floats
    energy: Floats


def traced(
    joint: Joint,
    commands: Floats,
    load: Floats | None = None,
    *,
    dt: float = DT,
    h: float | None = None,
    x0: Floats | None = None,
    seed: int = 0,
    voltage: bool = False,
) -> Trace:
    """Step a joint by hand, so that what its effects remember is seen too.

    Args:
        joint: The joint.
        commands: Currents [A], or voltages [V], shape (steps,).
        load: Load torque [N m] or load velocity [rad/s], shape (steps,); zero if absent.
        dt: Control step [s].
        h: Substep [s]; the control step if absent.
        x0: Initial state, shape (6,); zero if absent.
        seed: Seed of the random stream.
        voltage: Whether the commands are voltages.
    """
    steps = len(commands)
    loads = np.zeros(steps) if load is None else load
    batch = JointBatch(joint, 1, dt, dt if h is None else h, voltage=voltage)
    batch.seed(0, seed)
    if x0 is not None:
        batch.arrays.state[0] = x0
    batch.restart(np.ones(1, dtype=np.bool_), loads[:1])
    arrays = batch.arrays
    x, memory, currents = (np.empty((steps + 1, size)) for size in (6, arrays.memory.shape[1], 2))
    inputs = np.column_stack([commands, np.zeros(steps)])
    for k in range(steps + 1):
        x[k], memory[k], currents[k] = arrays.state[0], arrays.memory[0], arrays.currents[0]
        if k < steps:
            batch.step(inputs[k : k + 1], loads[k : k + 1])
    return Trace(x, memory, currents, total_energy(joint, x, memory))


def total_energy(joint: Joint, x: Floats, memory: Floats | None = None) -> Floats:
    """Return what a joint holds with all its effects [J], shape (n,).

    The load counts where it is free; where its motion is prescribed it belongs to the outside.

    Kinetic energy, springs with play and hardening, weight, contact, and what bristles and
    hysteresis could give back: sigma z^2 / 2, sum_j k_j z_j^2 / 2, tau_h delta_h zeta^2 / 2.

    Args:
        joint: The joint.
        x: States, shape (n, 6).
        memory: What effects remember, shape (n, MEMORY); nothing if absent.
    """
    p, (motor, gear, load) = joint.packed()[0][0], joint.structure_row.groups
    energy = 0.5 * (p["I_m"] * x[:, 3] ** 2 + p["I_g"] * x[:, 4] ** 2)
    if load >= 0:
        energy += 0.5 * p["I_l"] * x[:, 5] ** 2
        energy += p["weight"] * (1.0 - np.cos(x[:, 2] - p["weight_angle"]))
        depth, e = np.maximum(x[:, 2] - p["contact_position"], 0.0), p["contact_exponent"] + 1.0
        energy += p["contact_stiffness"] * depth**e / e
    if motor != gear:
        energy += 0.5 * p["k_g"] * beyond(x[:, 0] - x[:, 1], p) ** 2
    if gear != load:
        bend = x[:, 1] - x[:, 2]
        bend = beyond(bend, p) if motor == gear else bend
        linear = 0.5 * p["k_b"] * bend**2
        energy += linear if p["table_scale"] == 0.0 else p["table_scale"] * tabled(joint, bend)
        energy += 0.25 * p["k_3"] * bend**4
    if memory is not None:
        energy += remembered_energy(p, memory)
    return np.asarray(energy)


def beyond(x: Floats, p: Any) -> Floats:
    """Return the deflection beyond the play [rad]."""
    y = x - (p["play_offset"] if p["play_gap"] > 0.0 else 0.0)
    return np.asarray(np.sign(y) * np.maximum(np.abs(y) - 0.5 * p["play_gap"], 0.0))


def slip_elements(p: Any) -> tuple[Floats, Floats]:
    """Return yield deflections [rad] and stiffnesses [N m/rad] of the Maxwell slip elements.

    They fit c tau_h (1 - exp(-x / delta_h)) at deflections evenly spread up to 3 delta_h, where
    they reach tau_h.
    """
    count = int(p["slip_elements"])
    at = np.linspace(0.0, 3.0 * p["delta_h"], count + 1)
    height = p["tau_h"] / -np.expm1(-3.0)
    slopes = np.diff(height * -np.expm1(-at / p["delta_h"])) / np.diff(at)
    return at[1:], slopes - np.append(slopes[1:], 0.0)


def tabled(joint: Joint, bend: Floats) -> Floats:
    """Return the energy of a bar that is a table, at a scale of one [J]."""
    rows = spring_rows(joint.effects, "the table")
    x, torque = rows[:, 0], rows[:, 1]
    curve = PchipInterpolator(x, torque)
    inside = np.clip(bend, x[0], x[-1])
    over = bend - inside
    energy = curve.antiderivative()(inside) - curve.antiderivative()(0.0)
    return np.asarray(energy + curve(inside) * over + 0.5 * curve.derivative()(inside) * over**2)


def remembered_energy(p: Any, memory: Floats) -> Floats:
    """Return the energy of bristles and hysteresis [J], shape (n,)."""
    energy = np.zeros(len(memory))
    for body, letter in enumerate("mgl"):
        energy += 0.5 * p[f"sigma_{letter}"] * memory[:, BRISTLE + body] ** 2
    if p["tau_h"] > 0.0 and p["slip_elements"] >= 1.0:
        _, stiffness = slip_elements(p)
        energy += 0.5 * (memory[:, LOOP : LOOP + len(stiffness)] ** 2) @ stiffness
    elif p["tau_h"] > 0.0:
        energy += 0.5 * p["tau_h"] * p["delta_h"] * memory[:, LOOP] ** 2
    return energy
