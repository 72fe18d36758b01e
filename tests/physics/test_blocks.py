"""The code for blocks of joints gives what the general kernel gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from cjt_gym.envs.vector import TorqueTrackingVectorEnv
from cjt_gym.joint import load_joint
from cjt_gym.joint.batch import JointBatch
from cjt_gym.joint.kernel.arrays import VOLTS
from cjt_gym.joint.lanes.vector_math import decay, sine_cosine
from cjt_gym.joint.lanes.vectors import WIDTH, get, put
from cjt_gym.plant import SimulatedPlant

STEPS = 60
COGGING = {"f": (80.0, 480.0), "a": (0.5, 0.2), "b": (0.2, 0.1)}
DELAYED = {"command_delay": {"delay": 1.3e-3}, "measurement_delay": {"delay": 2e-3}}
LAGGING = {"current_lag": {"bandwidth": 60.0}, "current_saturation": {"i_p": 3.0}}
BREAKAWAY = {"d_cm": 1.0, "d_sm": 2.0, "v_s": 0.1}
HANGING = {"torque": 20.0, "angle": 0.5}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "linear": ("full_dynamics", {}),
    "smooth": ("full_dynamics", {"coulomb": {}, "cogging": COGGING}),
    "sharp": ("full_dynamics", {"coulomb": {"dq_0": 0.0}, "cogging": COGGING}),
    "three": ("full_dynamics", {"coulomb": {"d_cl": 1.0}, "viscous_asym": {"d_m_n": 1.0}}),
    "rigid gearbox": ("rigid_gearbox", {"coulomb_asym": {"d_cm_n": 1.0}, "cogging": COGGING}),
    "fixed": ("output_fixed", {"coulomb": {"dq_0": 0.0}, **DELAYED}),
    "measured": (
        "output_fixed_rigid_gearbox",
        {"coulomb": {}, "cogging": COGGING, **DELAYED, "noise": {}, "quantization": {}},
    ),
    "cogging": ("output_fixed_rigid_gearbox", {"cogging": COGGING}),
    "lagged": (
        "rigid_gearbox",
        {"coulomb": {}, **DELAYED, **LAGGING},
    ),
    "steep": ("full_dynamics", {"load_coulomb": {"d_cl": 2.0}}),
    "breakaway": ("full_dynamics", {"stribeck": BREAKAWAY, "gravity": HANGING, "cogging": COGGING}),
    "sharp breakaway": (
        "rigid_gearbox",
        {"stribeck": BREAKAWAY | {"dq_0": 0.0, "d_sl": 1.0}, "viscous_asym": {"d_m_n": 1.0}},
    ),
    "weight": ("rigid_gearbox", {"gravity": HANGING}),
    "smooth weight": ("full_dynamics", {"coulomb": {}, "cogging": COGGING, "gravity": HANGING}),
    "sharp weight": (
        "rigid_gearbox",
        {"coulomb": {"dq_0": 0.0}, "load_coulomb": {"d_cl": 2.0}, "gravity": HANGING, **LAGGING},
    ),
}
QUICK = (
    "smooth",
    "sharp",
    "sharp breakaway",
    "lagged",
    "steep",
    "smooth weight",
    "sharp weight",
    "breakaway",
)
LOADS = {"steep": 4e-4}  # a load so light that its friction is very steep
DRIFT = {"low": 0.9, "high": 1.1, "when": "drift", "time_constant": 0.05}


def plants(
    structure: str, effects: dict[str, Any], num: int, load: float = 3.0
) -> list[SimulatedPlant]:
    """Return two equal plants, of which the second uses the general kernel."""
    joint = load_joint("orange_80_6000", structure, effects=effects, parameters={"I_l": load})
    names: dict[str, Any] = {"k_b": DRIFT, "I_m": (0.9, 1.1)}
    names |= {f"{name}.d_cm": (0.5, 1.5) for name in effects if name.startswith("coul")}
    pair = [SimulatedPlant(joint, num, randomization=names) for _ in range(2)]
    pair[0].batch.use_blocks(joint)
    assert pair[0].batch.blocks is not None
    return pair


@pytest.mark.parametrize(
    "case", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]
)
def test_it_is_the_general_kernel(case: str) -> None:
    structure, effects = CASES[case]
    num = WIDTH + 3
    pair = plants(structure, effects, num, LOADS.get(case, 3.0))
    rng = np.random.default_rng(1)
    for plant in pair:
        plant.reset(seed=3)
    level = np.zeros(num)
    for k in range(STEPS):
        if k % 7 == 0:  # pushes and pauses, so that joints stop, stick and turn
            level = rng.uniform(-30.0, 30.0, num) * (rng.random(num) < 0.7)
        if k == STEPS // 2:
            for plant in pair:
                plant.restart(np.arange(num) % 3 == 0, np.zeros((num, 6)), np.zeros(num))
        first, second = (plant.step(level, 0.02 * level) for plant in pair)
    assert pair[0].batch.blocks is not None
    assert not pair[0].batch.blocks.left.any()
    assert np.abs(pair[1].batch.arrays.state).max() > 1e-3
    one, other = (plant.batch.arrays for plant in pair)
    scale = np.abs(other.state).max(axis=0) + 1e-9
    np.testing.assert_allclose(one.state / scale, other.state / scale, atol=1e-9)
    np.testing.assert_allclose(one.tau, other.tau, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(one.currents, other.currents, rtol=1e-14)
    np.testing.assert_allclose(first.q_m, second.q_m, rtol=1e-7, atol=2e-5)
    np.testing.assert_array_equal(one.rng, other.rng)


def test_a_state_that_is_not_finite_is_reported() -> None:
    plant = plants(*CASES["smooth"], WIDTH)[0]
    plant.reset(seed=0)
    with pytest.raises(Exception, match="ceased to be finite"):
        plant.step(np.full(WIDTH, np.nan))


def test_other_joints_use_the_general_kernel() -> None:
    for effects in ({"presliding": {"d_cm": 1.0, "sigma_m": 1e3}}, {"backlash": {"gap": 0.01}}):
        joint = load_joint("orange_80_6000", "full_dynamics", effects=effects)
        plant = SimulatedPlant(joint, 2)
        plant.batch.use_blocks(joint)
        assert plant.batch.blocks is None


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    num, seen = 4 * WIDTH + 3, []
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (20, num, 1))
    for threads in (1, 3):
        monkeypatch.setattr("cjt_gym.envs.core.threads_for", lambda _, count=threads: count)
        env = TorqueTrackingVectorEnv(num, structure="full_dynamics", effects={"coulomb": {}})
        env.reset(seed=0)
        seen.append([env.step(action.astype(np.float32))[0] for action in actions])
    np.testing.assert_array_equal(*seen)


@njit
def evaluate(block: Any, out: Any) -> None:
    """Write sine, cosine and exp(-2 |x|) of every row."""
    for k in range(block.shape[0]):
        sine, cosine = sine_cosine(get(block, k))
        put(out, 3 * k, sine)
        put(out, 3 * k + 1, cosine)
        put(out, 3 * k + 2, decay(get(block, k)))


def test_functions_are_as_exact_as_promised() -> None:
    rng, rows = np.random.default_rng(0), 300
    x = rng.uniform(-3.0, 3.0, (rows, WIDTH))
    x[: rows // 3] *= 1e-3
    x[-rows // 3 :] *= 3e4
    x[0] = 0.0
    out = np.zeros((3 * rows, WIDTH))
    evaluate(x, out)
    for k, exact in enumerate((np.sin(x), np.cos(x), np.exp(-2.0 * np.minimum(np.abs(x), 20.0)))):
        np.testing.assert_allclose(out[k::3], exact, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("dry", [{}, {"coulomb": {"d_cm": 2.0, "dq_0": 0.0}}, {"coulomb": {}}])
@pytest.mark.parametrize("structure", ["output_fixed_rigid_gearbox", "full_dynamics"])
@pytest.mark.parametrize(("volts", "limited"), [(6.0, False), (20.0, True)])
def test_a_voltage_without_inductance(
    structure: str, dry: dict[str, Any], volts: float, *, limited: bool
) -> None:
    effects = {**dry, "command_delay": {"delay": 1.3e-3}, "viscous_asym": {"d_m_n": 1.0}}
    joint = load_joint("orange_80_6000", structure, "static", effects=effects)
    num, rng = WIDTH + 3, np.random.default_rng(0)
    pair = [JointBatch(joint, num, 1e-3, 5e-4, voltage=True) for _ in range(2)]
    pair[0].use_blocks(joint)
    assert pair[0].blocks is not None
    level, left = np.zeros((num, 2)), False  # some beyond the largest current
    for batch in pair:
        batch.restart(np.ones(num, dtype=np.bool_), np.zeros(num))
    for k in range(STEPS):
        if k % 7 == 0:
            level[:, 0] = rng.uniform(-volts, volts, num) * (rng.random(num) < 0.7)
        for batch in pair:
            batch.step(level, 0.02 * level[:, 0])
        left |= bool(pair[0].blocks.left.any())
        one, other = (batch.arrays for batch in pair)
        scale = np.abs(other.state).max(axis=0) + 1e-9
        np.testing.assert_allclose(one.state / scale, other.state / scale, atol=1e-9)
        np.testing.assert_allclose(one.currents, other.currents, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(one.memory[:, VOLTS], other.memory[:, VOLTS], atol=1e-8)
    assert np.abs(pair[1].arrays.state).max() > 1e-3
    assert left == limited
