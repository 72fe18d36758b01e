"""The environments of robots keep Gymnasium's promises, alone and around a torque controller."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from cjt_gym.baselines.table import make_controller
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.registry import ENVIRONMENTS, ROBOT

pytest.importorskip("mujoco")


def controller(joint: Joint, dt: float) -> object:
    return make_controller("pid_inner_dob", joint, dt)


ROBOTS = [name for name, row in ENVIRONMENTS.items() if row | ROBOT == row]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_checker_passes_without_a_warning(name: str) -> None:
    env = gym.make(name, effects=["coulomb", "noise"], randomization={"k_b": (0.9, 1.1)})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


def test_the_arm_follows_under_impedance_control() -> None:
    env = gym.make("CJT/Arm-v0", effects=["coulomb"], base_controller=controller)
    seen, _ = env.reset(seed=1)
    errors = []
    for _ in range(300):
        wanted, rate = 0.5 * seen[1], 5.0 * (seen[2] - seen[3])
        torque = 150.0 * wanted + 10.0 * rate + 4.5 * 9.81 * 0.35 * np.sin(np.pi * seen[0])
        seen, _, terminated, _, info = env.step(np.array([torque / 60.0], dtype=np.float32))
        assert not terminated
        errors.append(info["q_wanted"][0] - info["q"][0])
    assert np.sqrt(np.mean(np.square(errors[100:]))) < 0.1


def test_what_does_not_fit_is_refused() -> None:
    env = gym.make("CJT/Arm-v0", disable_env_checker=True).unwrapped
    env.reset(seed=0)
    with pytest.raises(ConfigurationError, match="The action must be finite"):
        env.step(np.array([np.nan], dtype=np.float32))
    with pytest.raises(ConfigurationError, match="action_scale"):
        gym.make("CJT/Arm-v0", action_scale=-1.0)
