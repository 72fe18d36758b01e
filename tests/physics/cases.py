"""What the physics tests share: states, stored energy, random valid joints, one excitation."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from cjt_gym.joint import STRUCTURES, Joint, load_joint_file
from cjt_gym.records import Record

Floats = NDArray[np.float64]
Effects = dict[str, dict[str, Any]]
STATES = ("q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l")
FIXED = tuple(name for name, row in STRUCTURES.items() if row.output_fixed)
FREE = tuple(name for name in STRUCTURES if name not in FIXED)
DT = 1e-3
EPS = float(np.finfo(np.float64).eps)


def states(record: Record) -> Floats:
    """Return the true states of a record, shape (samples, 6) [rad, rad/s]."""
    return np.column_stack([record[f"true_{name}"] for name in STATES])


def stored_energy(joint: Joint, x: Floats) -> Floats:
    """Return kinetic and elastic energy of the joint for states of shape (n, 6) [J].

    The load counts where it is free; where its motion is prescribed it belongs to the outside.
    """
    p, row = joint.parameters, joint.structure_row
    motor, gear, load = row.groups
    energy = 0.5 * p.I_m * x[:, 3] ** 2 + 0.5 * p.I_g * x[:, 4] ** 2
    if not row.output_fixed:
        energy += 0.5 * p.I_l * x[:, 5] ** 2
    if motor != gear:
        energy += 0.5 * p.k_g * (x[:, 0] - x[:, 1]) ** 2
    if gear != load:
        energy += 0.5 * p.k_b * (x[:, 1] - x[:, 2]) ** 2
    return np.asarray(energy)


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
