"""The linear part is exact: zero-order hold at any step, against SciPy and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from cjt_gym.joint import STRUCTURES, Joint, load_joint
from cjt_gym.joint.batch import JointBatch
from tests.physics.cases import (
    EPS,
    Floats,
    initial_state,
    known_grid,
    log_range,
    lossless,
    states,
    valid_parameters,
)

DT = 1e-3
GRID = known_grid()


def own_state(joint: Joint, x: Floats) -> Floats:
    """Return the structure's own state [z, q_l, dz] from that of the bodies."""
    row = joint.structure_row
    first = [row.groups.index(g) for g in range(row.size)]
    return x[[*first, *([2] if row.output_fixed else []), *(3 + b for b in first)]]


def scaled_error(computed: Floats, exact: Floats, h: float, joint: Joint) -> float:
    """Return the largest error of A or B with velocities counted per step, which balances them."""
    velocity = joint.structure_row.order - joint.structure_row.size
    unit = np.where(np.arange(len(exact)) >= velocity, h, 1.0)
    columns = 1.0 / unit if exact.shape[0] == exact.shape[1] else np.ones(exact.shape[1])
    scale = unit[:, None] * columns[None, :]
    return float(np.abs((computed - exact) * scale).max() / np.abs(exact * scale).max())


@pytest.mark.parametrize(("name", "structure"), GRID)
def test_a_control_step_is_the_exact_zero_order_hold(name: str, structure: str) -> None:
    """One second of random inputs against `state_space(dt)`; 1e-9 is rounding times stiffness."""
    joint = load_joint(name, structure, effects={})
    rng = np.random.default_rng(2)
    torque = rng.normal(0.0, 0.1 * min(joint.torque_limit, 200.0), 1001)
    load = rng.normal(0.0, 0.3, 1001)
    start = 0.01 * initial_state(8)
    system = joint.state_space(DT)
    for substep in (DT, 1e-4, 1e-5):
        record = joint.simulate(torque, load, dt=DT, dt_physics=substep, x0=start)
        x = own_state(joint, states(record)[0])
        outputs = np.zeros((1001, 7))
        for k in range(1001):
            outputs[k] = system.C @ x + system.D @ (torque[k], load[k])
            x = system.A @ x + system.B @ (torque[k], load[k])
        columns = ["q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l"]
        columns += ["tau"] * (structure != "rigid")
        for j, column in enumerate(columns):
            error = np.abs(record[f"true_{column}"] - outputs[:, j]).max()
            assert error <= 1e-9 * np.abs(outputs[:, j]).max(), column


@pytest.mark.parametrize(("name", "structure"), GRID)
def test_sampled_state_space_agrees_with_scipy(name: str, structure: str) -> None:
    joint = load_joint(name, structure, effects={})
    system = joint.state_space()
    a, b, c, d, _ = signal.cont2discrete((system.A, system.B, system.C, system.D), DT, "zoh")
    sampled = joint.state_space(DT)
    assert scaled_error(sampled.A, a, DT, joint) < 1e-9
    assert scaled_error(sampled.B, b, DT, joint) < 1e-9
    np.testing.assert_array_equal(sampled.C, c)
    np.testing.assert_array_equal(sampled.D, d)


def test_two_mass_resonance() -> None:
    """Undamped: sqrt(k (1 / I_1 + 1 / I_2)) with a free load, sqrt(k / I_1) with a held one."""
    free = lossless("rigid_gearbox", {})
    p = free.parameters
    one, two = p.I_m + p.I_g, p.I_l
    fastest = np.abs(np.linalg.eigvals(free.state_space().A).imag).max()
    assert fastest == pytest.approx(np.sqrt(p.k_b * (1 / one + 1 / two)), rel=1e-12)
    held = lossless("output_fixed_rigid_gearbox", {})
    slow = np.abs(np.linalg.eigvals(held.state_space().A).imag).max()
    assert slow == pytest.approx(np.sqrt(p.k_b / one), rel=1e-12)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(valid_parameters(), st.sampled_from(sorted(STRUCTURES)), log_range(1e-6, 1e-2))
def test_compiled_discretisation_agrees_with_scipy(
    parameters: dict[str, float], structure: str, h: float
) -> None:
    """SciPy's matrix exponential, balanced by counting velocities per step.

    Both scale and square; each squaring may double the rounding: eps (omega h)**2 and eps d h / I.
    """
    joint = load_joint("generic", structure, effects={}, parameters=parameters)
    batch = JointBatch(joint, 1, h, h)
    a, b = batch.arrays.a[0], batch.arrays.b[0]
    order, size = a.shape[0], joint.structure_row.size
    system = joint.state_space()
    rate = np.where(np.arange(order) >= order - size, h, 1.0)
    joined = np.zeros((order + 2, order + 2))
    joined[:order, :order] = system.A * h * rate[:, None] / rate[None, :]
    joined[:order, order:] = system.B * h * rate[:, None]
    exact = linalg.expm(joined)
    allowed = 100.0 * EPS * max(1.0, np.abs(joined[:, :order]).sum(axis=0).max())
    got = a * rate[:, None] / rate[None, :]
    assert np.abs(got - exact[:order, :order]).max() <= allowed
    inputs = b[:, :2] * rate[:, None]
    largest = max(1.0, np.abs(exact[:order, order:]).max())
    assert np.abs(inputs - exact[:order, order:]).max() <= allowed * largest


@pytest.mark.parametrize("structure", STRUCTURES)
def test_transfer_function_matches_the_state_space(structure: str) -> None:
    joint = load_joint("generic", structure, effects={})
    s = 2j * np.pi * np.array([0.5, 5.0, 50.0])
    system, f = joint.state_space(), joint.transfer_function("dq_m", "tau_m")
    expected: list[Any] = [system(x)[3, 0] for x in s]
    np.testing.assert_allclose([f(x) for x in s], expected, rtol=1e-8)
