"""A policy on top of classical laws: its action is added to what the law alone commands."""

from __future__ import annotations

from functools import partial

import gymnasium
import numpy as np
import pytest

import cjt_gym  # noqa: F401 - registers the environments
from cjt_gym.baselines import make_controller
from cjt_gym.joint import Joint
from cjt_gym.plant import limits_of

BASES = ("pd_feedforward", "pid_inner_dob", "passivity_momentum", "lqg", "h_infinity", "mpc")
BASES += ("ripple_learning", "iterative_learning")


def law(name: str, joint: Joint, dt: float) -> object:
    return make_controller(name, joint, dt)


@pytest.mark.parametrize("name", BASES)
def test_an_action_is_added_to_the_command_of_the_base(name: str) -> None:
    env = gymnasium.make(
        "CJT/TorqueTracking-v0",
        joint="orange_80_6000",
        structure="output_fixed_rigid_gearbox",
        effects={"coulomb": {}, "command_delay": {"delay": 1e-3}, "noise": {}},
        reference="multisine",
        base_controller=partial(law, name),
        episode_steps=40,
    )
    env.reset(seed=3)
    commands = []
    for k in range(40):
        action = np.array([0.2 if k % 2 else 0.0], dtype=np.float32)
        observation, reward, _, truncated, info = env.step(action)
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert (info["residual"] != 0.0) == bool(k % 2)
        sent = info["base_action"] + info["residual"]
        assert info["tau_command"] == pytest.approx(sent)
        commands.append(sent)
    limit = limits_of(env.unwrapped.episodes.settings.joint).tau  # type: ignore[attr-defined]
    assert truncated
    assert np.ptp(commands) > 0.0
    assert np.max(np.abs(commands)) < limit
