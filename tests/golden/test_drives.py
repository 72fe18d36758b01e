"""The electrical drives against the toolbox: equations of nine sets, and motion under voltage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from cjt_gym.joint.kernel.drives import advance_dq, static_current
from tests.golden.conftest import JointOf
from tests.golden.loader import (
    STRUCTURES,
    Array,
    Trajectory,
    bodies_of,
    electrical,
    electrical_trajectories,
    linear,
    oracle_numbers,
    oracle_sets,
)

NO_LIMIT = {"v_0": 1e6, "i_p": 1e6}
COMPOSED = {"static": "vd0", "rl": "vdL"}
TRAJECTORIES = electrical_trajectories()


def held_motion(a: Array, b: Array, inputs: Array, dt: float) -> Array:
    """Return the states of dx/dt = a x + b u from rest, inputs held; shape (n, order)."""
    order = len(a)
    joined = np.zeros((order + 2, order + 2))
    joined[:order] = np.hstack([a, b]) * dt
    step = expm(joined)
    states = np.zeros((len(inputs), order))
    for k in range(len(inputs) - 1):
        states[k + 1] = step[:order, :order] @ states[k] + step[:order, order:] @ inputs[k]
    return states


@pytest.mark.parametrize("drive", COMPOSED)
@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("name", oracle_sets())
def test_voltage_driven_joint_follows_the_composed_matrices(
    name: str, structure: str, drive: str, joint_of: JointOf
) -> None:
    a, b = (linear(name, structure, f"{COMPOSED[drive]}_{key}") for key in "AB")
    rng = np.random.default_rng(5)
    inputs = np.column_stack([rng.uniform(-3.0, 3.0, 60), rng.uniform(-0.1, 0.1, 60)])
    golden = held_motion(a, b, inputs, 1e-4)
    joint = joint_of(name, structure, drive, replace=NO_LIMIT)
    record = joint.simulate(voltage=inputs[:, 0], load=inputs[:, 1], dt=1e-4, dt_physics=1e-7)
    bodies = bodies_of(structure, golden[:, :-1] if drive == "rl" else golden)
    for column, symbol in enumerate(("q_m", "q_g", "q_l", "dq_m", "dq_g")):
        peak = np.abs(bodies[:, column]).max()
        error = np.abs(record[f"true_{symbol}"] - bodies[:, column]).max() / max(peak, 1e-12)
        assert error < 1e-7, symbol
    if drive == "rl":
        peak = np.abs(golden[:, -1]).max()
        assert np.abs(record["true_i"] - golden[:, -1]).max() < 1e-7 * peak


@pytest.mark.parametrize("name", oracle_sets())
def test_static_drive_gives_the_current_of_the_terminal_voltage(
    name: str, joint_of: JointOf
) -> None:
    p = joint_of(name, "rigid", "static", replace=NO_LIMIT).packed()[0].view(np.recarray)[0]
    to_current, to_torque = electrical(name, "static", "D")
    np.testing.assert_allclose(to_current, electrical(name, "rl", "sys_dc")[0], rtol=1e-14)
    for voltage, speed in [(1.0, 0.0), (0.0, 1.0), (7.0, -2.0)]:
        current, slope = static_current(p, p.k_t * p.n, p.r, voltage, True, speed)
        assert current == pytest.approx(to_current @ [voltage, speed], rel=1e-14)
        assert slope == pytest.approx(to_current[1], rel=1e-14)
        torque = p.k_t * p.n * current
        assert torque == pytest.approx(to_torque @ [voltage, speed], rel=1e-14)


@pytest.mark.parametrize("name", oracle_sets())
def test_slope_of_the_d_and_q_currents(name: str, joint_of: JointOf) -> None:
    joint = joint_of(name, "rigid", "dq", replace=NO_LIMIT)
    p = joint.packed()[0].view(np.recarray)[0]
    x, u = electrical(name, "dq", "x"), electrical(name, "dq", "u")
    h = 1e-8
    for k in range(20):
        (i_q, i_d), (v_q, v_d, speed) = x[:, k], u[:, k]
        now = p.k_t * p.n, p.r, complex(i_q, i_d), complex(v_q, v_d), speed
        ahead, behind = advance_dq(p, *now, h), advance_dq(p, *now, -h)
        slope = (np.array(ahead) - np.array(behind)) / (2.0 * h)
        golden = electrical(name, "dq", "x_dot")[:, k]
        np.testing.assert_allclose(slope, golden, rtol=0.0, atol=1e-6 * np.abs(golden).max())
    torque = p.k_t * p.n * x[0]
    np.testing.assert_allclose(torque, electrical(name, "dq", "tau_m"), rtol=1e-14)


@pytest.mark.parametrize("trajectory", TRAJECTORIES, ids=lambda t: t.name)
def test_motion_under_voltage(trajectory: Trajectory, joint_of: JointOf) -> None:
    joint = joint_of(trajectory.joint, trajectory.structure, trajectory.drive)
    voltage, load = trajectory.inputs[:, :-1], trajectory.inputs[:, -1]
    voltage = voltage if trajectory.drive == "dq" else voltage[:, 0]
    record = joint.simulate(voltage=voltage, load=load, dt=trajectory.dt, dt_physics=5e-7)
    p = oracle_numbers(trajectory.joint)
    pairs = {name: trajectory.states[:, k] for k, name in enumerate(("q_m", "q_g", "q_l", "dq_m"))}
    if trajectory.drive != "static":
        pairs["i"] = trajectory.current.reshape(len(trajectory.tau_m), -1)[:, 0]
        np.testing.assert_allclose(p["k_t"] * p["n"] * pairs["i"], trajectory.tau_m, rtol=1e-12)
    for name, golden in pairs.items():
        computed = record[f"true_{name}"][:: trajectory.every]
        error = np.abs(computed - golden).max() / max(np.abs(golden).max(), 1e-12)
        assert error < 1e-6, name
