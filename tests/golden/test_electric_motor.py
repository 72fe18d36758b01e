"""The d-q drive and the task of the current loop against gym-electric-motor."""

from __future__ import annotations

import json
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import cjt_gym  # noqa: F401 - registers the environments
from cjt_gym.joint import Joint, load_joint
from tests.golden.loader import HERE, Array

GOLDEN: dict[str, Any] = json.loads((HERE / "electric_motor.json").read_text("utf-8"))
MOTOR: dict[str, float] = GOLDEN["motor"]
N = 80.0
"""The ratio of the gear; the golden figures are those of the motor's shaft."""


def motor(**values: float) -> Joint:
    """Return the motor as a rigid joint: k_t is 3/2 p psi for currents that keep amplitudes."""
    k_t = 1.5 * MOTOR["p"] * MOTOR["psi_p"]
    electrical = {"p": MOTOR["p"], "r": MOTOR["r_s"], "l_a": MOTOR["l_q"], "k_t": k_t, "n": N}
    nothing = dict.fromkeys(("I_g", "I_l", "d_m", "d_g", "d_l", "d_m_n", "d_g_n", "d_l_n"), 0.0)
    supply = {"v_0": MOTOR["v_0"], "i_p": 1e3}
    parameters = nothing | electrical | supply | values
    return load_joint("orange_80_6000", "rigid", "dq", effects=(), parameters=parameters)


def motion(joint: Joint, speed: float, dt_physics: float) -> Array:
    """Return [i_q, i_d, torque, speed] at the motor's shaft at the end of each level."""
    every = GOLDEN["samples_a_level"]
    volts = np.repeat(GOLDEN["levels"], every, axis=0)
    volts = np.vstack([volts, volts[-1:]])  # a record holds what is there when a sample begins
    x0 = [0.0, 0.0, 0.0, *[speed / N] * 3]
    r = joint.simulate(voltage=volts, dt=GOLDEN["dt"], dt_physics=dt_physics, x0=x0)
    columns = (r["true_i"], r["true_i_d"], r["true_tau_m"] / N, r["true_dq_m"] * N)
    return np.column_stack(columns)[every::every]


def difference(found: Array, golden: Any) -> float:
    """Return the largest difference over the largest value of its column."""
    golden = np.array(golden)
    return float((np.abs(found - golden) / np.abs(golden).max(axis=0)).max())


def test_currents_and_torque_at_a_constant_speed() -> None:
    """Exact for voltages that are held, whatever the substep."""
    found = motion(motor(I_m=1e12), GOLDEN["speed"], GOLDEN["dt"])
    assert difference(found, GOLDEN["held"]) < 1e-10


def test_a_rotor_that_accelerates() -> None:
    """The order is two: a quarter of the substep leaves a sixteenth of the difference."""
    damping = dict.fromkeys(("d_m", "d_m_n"), MOTOR["damping"] * N**2)
    joint = motor(I_m=MOTOR["j"] * N**2, **damping)
    coarse, fine, finest = (
        difference(motion(joint, 0.0, h), GOLDEN["free"]) for h in (1e-4, 2.5e-5, 1e-6)
    )
    assert coarse < 1e-3
    assert coarse / fine == pytest.approx(16.0, rel=0.1)
    assert finest < 1e-7


def test_rewards_and_end_of_the_torque_task() -> None:
    half = 0.5 * 1.5 * MOTOR["p"] * MOTOR["psi_p"] * N * MOTOR["i_p"]
    joint = motor(I_m=1e12, i_p=MOTOR["i_p"])
    env: Any = gym.make("CJT/CurrentControl-v0", joint=joint, reference=np.full(2, half)).unwrapped
    env.reset(seed=0)
    env.batch.arrays.state[0, 3:] = GOLDEN["speed"] / N
    found, terminated = [], False
    for action in GOLDEN["actions"]:
        _, reward, terminated, *_ = env.step(np.array(action))
        found.append(reward)
        if terminated:
            break
    assert terminated
    np.testing.assert_allclose(found, GOLDEN["rewards"], rtol=0, atol=1e-9)
