"""No substep creates energy, whatever its length; ports take out no more than was put in.

Forces are constant over a substep, so that their work is force times displacement exactly. The
bounds therefore hold to rounding, which the matrix exponential multiplies by about (omega h)**2.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from tests.physics.cases import (
    EPS,
    FIXED,
    FREE,
    Effects,
    Floats,
    friction_effects,
    initial_state,
    log_range,
    states,
    stiffness_number,
    total_energy,
    valid_parameters,
)

SEEDS = st.integers(0, 2**32 - 1)


def rounding(joint: Joint, h: float) -> float:
    return 64.0 * EPS * max(1.0, stiffness_number(joint, h))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    valid_parameters(),
    st.sampled_from(sorted(STRUCTURES)),
    friction_effects(),
    log_range(1e-6, 1e-2),
    SEEDS,
)
def test_a_joint_left_alone_never_gains_energy(
    parameters: dict[str, float], structure: str, effects: Effects, h: float, seed: int
) -> None:
    joint = load_joint("generic", structure, effects=effects, parameters=parameters)
    record = joint.simulate(np.zeros(200), dt=h, dt_physics=h, x0=initial_state(seed))
    energy = total_energy(joint, states(record))
    assert np.diff(energy).max() <= rounding(joint, h) * energy[0]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(valid_parameters(), st.sampled_from(sorted(STRUCTURES)), log_range(1e-6, 1e-2), SEEDS)
def test_a_shorted_motor_without_inductance_only_brakes(
    parameters: dict[str, float], structure: str, h: float, seed: int
) -> None:
    joint = load_joint("generic", structure, "static", effects={}, parameters=parameters)
    record = joint.simulate(voltage=np.zeros(200), dt=h, dt_physics=h, x0=initial_state(seed))
    energy = total_energy(joint, states(record))
    assert np.diff(energy).max() <= rounding(joint, h) * energy[0]


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    valid_parameters(),
    st.sampled_from(FREE),
    friction_effects(),
    log_range(1e-6, 1e-2),
    SEEDS,
)
def test_a_free_load_takes_no_more_energy_than_motor_and_port_supply(
    parameters: dict[str, float], structure: str, effects: Effects, h: float, seed: int
) -> None:
    """Passivity from (tau_m, dq_m) and (tau_l, dq_l) to the stored energy, step by step."""
    rng = np.random.default_rng(seed)
    tau_m, tau_l = rng.uniform(-30.0, 30.0, (2, 200))
    joint = load_joint("generic", structure, effects=effects, parameters=parameters)
    record = joint.simulate(tau_m, tau_l, dt=h, dt_physics=h, x0=initial_state(seed))
    x = states(record)
    energy, moved = total_energy(joint, x), np.diff(x, axis=0)
    supplied = tau_m[:-1] * moved[:, 0] + tau_l[:-1] * moved[:, 2]
    scale = energy.max() + np.abs(supplied).max()
    rounded_angles = EPS * np.abs(x[:, :3]).max() * (np.abs(tau_m) + np.abs(tau_l)).max()
    allowed = rounding(joint, h) * scale + rounded_angles
    assert (np.diff(energy) - supplied).max() <= allowed


def mean_joint_torque(joint: Joint, x: Floats, tau_m: Floats, h: float) -> Floats:
    """Return the mean torque in the bar over each step, from the momentum of motor and gear."""
    p = joint.parameters
    v, gained = np.diff(x[:, :3], axis=0) / h, np.diff(x[:, 3:], axis=0)
    friction = joint.nonlinear_torque(np.zeros_like(v), v)
    on_motor = tau_m[:-1] - p.d_m * v[:, 0] + friction[:, 0]
    on_gear = -p.d_g * v[:, 1] + friction[:, 1]
    return np.asarray(on_motor + on_gear - (p.I_m * gained[:, 0] + p.I_g * gained[:, 1]) / h)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    valid_parameters(),
    st.sampled_from(FIXED),
    friction_effects(sharp=False),
    log_range(1e-5, 1e-3),
    SEEDS,
)
def test_any_load_motion_extracts_at_most_the_stored_energy(
    parameters: dict[str, float], structure: str, effects: Effects, h: float, seed: int
) -> None:
    """Passivity at (tau, dq_l) with smooth friction, where the mean torque is known exactly."""
    rng = np.random.default_rng(seed)
    dq_l, tau_m = rng.normal(0.0, 1.0, 200), np.zeros(200)
    joint = load_joint("generic", structure, effects=effects, parameters=parameters)
    record = joint.simulate(tau_m, dq_l, dt=h, dt_physics=h, x0=initial_state(seed))
    x = states(record)
    energy = total_energy(joint, x)
    extracted = np.cumsum(mean_joint_torque(joint, x, tau_m, h) * dq_l[:-1]) * h
    spread = energy.max() + np.abs(extracted).max()
    assert (extracted + energy[1:] - energy[0]).max() <= 1e-9 * spread


@pytest.mark.parametrize("structure", FIXED)
@pytest.mark.parametrize("name", ["orange_80_6000", "example"])
def test_sharp_friction_is_passive_at_the_load(name: str, structure: str) -> None:
    """The mean torque is taken by the trapezoidal rule, of second order in h = 10 us."""
    h, steps = 1e-5, 20_000
    t = np.arange(steps) * h
    dq_l = 0.3 * np.sin(2 * np.pi * 7.0 * t) + 0.2 * np.sin(2 * np.pi * 31.0 * t)
    joint = load_joint(name, structure, effects={"coulomb": {"dq_0": 0.0}})
    record = joint.simulate(np.zeros(steps), dq_l, dt=h, dt_physics=h, x0=initial_state(1))
    energy, tau = total_energy(joint, states(record)), record["true_tau"]
    extracted = np.cumsum(0.5 * (tau[1:] + tau[:-1]) * dq_l[:-1]) * h
    assert (extracted + energy[1:] - energy[0]).max() <= 1e-3 * energy[0]


def drift(structure: str, h: float) -> float:
    """Return the largest change of energy over 0.5 s on a cogging motor, relative to its well."""
    f, a, b = np.array([50.0, 150.0]), np.array([0.4, 0.2]), np.array([0.3, -0.2])
    lossless = dict.fromkeys(("d_m", "d_g", "d_l", "d_m_n", "d_g_n", "d_l_n", "d_mg", "d_gl"), 0.0)
    joint = load_joint(
        "generic", structure, effects={"cogging": {"f": f, "a": a, "b": b}}, parameters=lossless
    )
    x0 = np.array([0.0, 0.001, 0.002, 0.4, 0.4, 0.0 if structure in FIXED else 0.4])
    steps = round(0.5 / h)
    x = states(joint.simulate(np.zeros(steps), dt=h, dt_physics=h, x0=x0))
    angle = np.outer(x[:, 0], f)
    potential = (-np.sin(angle) * a / f + np.cos(angle) * b / f).sum(axis=1)
    energy = total_energy(joint, x) + potential
    return float(np.abs(energy - energy[0]).max() / np.ptp(potential))


@pytest.mark.parametrize("structure", STRUCTURES)
def test_cogging_conserves_energy_to_second_order(structure: str) -> None:
    """Halving the step quarters the drift; at 0.1 ms it is small against the cogging's wells."""
    coarse, fine = drift(structure, 1e-4), drift(structure, 5e-5)
    assert coarse < 1e-3
    assert 3.5 < coarse / fine < 4.5
