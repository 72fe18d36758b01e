"""The environment of the current loop."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as check_env_sb3
from stable_baselines3.common.vec_env import DummyVecEnv

import cjt_gym  # noqa: F401 - registers the environments
from cjt_gym.baselines.current_control import CurrentController
from cjt_gym.envs.sb3 import TorqueTrackingVecEnv
from cjt_gym.errors import ConfigurationError, ParameterError, UnknownNameError
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.evaluation.metrics import nrmse
from cjt_gym.training.evaluation.rollout import ControllerAgent, joint_of, run_task
from cjt_gym.training.evaluation.tasks import get_task

NAME = "CJT/CurrentControl-v0"


def make(**arguments: Any) -> Any:
    return gym.make(NAME, **arguments).unwrapped


@pytest.mark.parametrize("drive", ["dq", "rl"])
def test_both_checkers_pass(drive: str) -> None:
    env = make(drive=drive, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)
        check_env_sb3(env)


def rewards(
    env: Any, law: CurrentController | None, seed: int, volts: tuple[float, float] = (0.0, 0.0)
) -> list[float]:
    """Return the rewards of an episode under a current controller, or under constant voltages."""
    p = env.joint.parameters
    _, info = env.reset(seed=seed)
    found: list[float] = []
    done = False
    while not done:
        action = np.array(volts)
        if law is not None:
            wanted = np.array([info["tau_reference"] / (p.k_t * p.n)])
            currents = np.array([[info["i_q"], info["i_d"]]])
            fresh = np.array([not found])
            action = law.act(wanted, currents, np.array([info["dq_m"]]), fresh)[0] / p.v_0
        _, reward, terminated, truncated, info = env.step(action)
        found.append(reward)
        done = terminated or truncated
    return found


def test_the_current_controller_solves_it() -> None:
    """An episode of 0.1 s has ten steps, whose transients of 1 / w are all that is left."""
    env = make()
    law = CurrentController(env.joint, env.dt, 500.0)
    gained = [rewards(env, law, seed) for seed in range(3)]
    assert all(len(one) == 1000 for one in gained)
    assert np.mean(gained) > 0.98
    assert np.mean(rewards(env, None, 0)) < 0.8


def test_to_live_on_is_always_worth_more() -> None:
    """With any discount: no reward is negative, and the step that ends an episode earns nothing."""
    env = make()
    idle, wild = rewards(env, None, 0), rewards(env, None, 0, (1.0, 0.0))
    assert len(wild) < 10 < len(idle)
    assert wild[-1] == 0.0
    assert min(idle) >= 0.0
    for discount in (0.5, 0.9, 0.99, 1.0):
        earned = [np.sum(discount ** np.arange(len(one)) * one) for one in (idle, wild)]
        assert earned[0] > earned[1]


def test_the_speed_is_held_and_currents_at_their_limit_end_the_episode() -> None:
    env = make()
    _, before = env.reset(seed=2)
    steps, terminated, reward = 0, False, 0.0
    while not terminated:
        _, reward, terminated, _, info = env.step(np.array([np.sign(before["dq_m"]) * -1.0, 0.0]))
        steps += 1
    assert reward == 0.0
    assert steps < 30
    assert np.hypot(info["i_q"], info["i_d"]) == pytest.approx(30.0)
    assert info["dq_m"] == pytest.approx(before["dq_m"], rel=1e-6)


def test_it_can_be_repeated() -> None:
    env = make(effects={"torque_offset": {"torque": 1.0}})
    runs = [
        [env.reset(seed=4)[0], *(env.step(np.full(2, 0.1))[0] for _ in range(20))] for _ in "ab"
    ]
    np.testing.assert_array_equal(*runs)
    assert not np.array_equal(env.reset(seed=5)[0], runs[0][0])


def test_what_it_cannot_do_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="drive of CurrentControlEnv must be 'dq' or 'rl'"):
        make(drive="current")
    with pytest.raises(UnknownNameError, match="drive"):
        make(drive="dx")
    with pytest.raises(ConfigurationError, match="speed must be"):
        make(speed=-1.0)
    with pytest.raises(ParameterError, match="emps"):
        make(joint="emps")
    env = make()
    env.reset(seed=0)
    with pytest.raises(ConfigurationError, match="The action must be finite"):
        env.step(np.array([np.nan, 0.0]))
    with pytest.raises(UnknownNameError, match="reset option"):
        env.reset(options={"speed": 1.0})


def test_the_benchmark_has_a_task_of_the_current_loop() -> None:
    """Half the bandwidth leaves a larger error."""
    errors, task = [], get_task("current_loop")
    for bandwidth in (500.0, 250.0):
        loop = {"current_control": {"bandwidth": bandwidth, "rate": 1e4}}
        conditions = Conditions("orange_80_6000", drive="dq", effects=loop)
        setting = task.setting(conditions, joint_of(conditions))
        errors.append(nrmse(run_task(ControllerAgent("open_loop"), setting, 2, 0)))
    assert 0.02 < errors[0] < errors[1] < 0.5
    assert not task.suits(conditions.structure, ControllerAgent("pd_feedforward"))


@pytest.mark.slow
def test_a_short_training_comes_near_the_current_controller() -> None:
    """Without voltages an episode earns some 360 of 1000, the current controller 992."""
    inner = DummyVecEnv([lambda: gym.make(NAME) for _ in range(8)])
    model = PPO(
        "MlpPolicy",
        inner,
        n_steps=256,
        batch_size=256,
        gamma=0.9,
        gae_lambda=0.9,
        policy_kwargs={"log_std_init": -1.5},
        seed=0,
        device="cpu",
    )
    model.learn(25_000)
    env, gained = make(), []
    for seed in range(1000, 1004):
        observation, _ = env.reset(seed=seed)
        done = False
        while not done:
            action, _ = model.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, _ = env.step(action)
            gained.append(reward)
            done = terminated or truncated
    assert sum(gained) / 4 > 900.0


@pytest.mark.slow
def test_a_policy_trains_on_voltage_drives() -> None:
    """Both loops: the torque with the current controller inside, and the voltages themselves."""
    outer = TorqueTrackingVecEnv(2, drive="dq", effects=["coulomb"], episode_steps=50)
    inner = DummyVecEnv([lambda: gym.make(NAME, episode_steps=50)])
    for env in (outer, inner):
        model = PPO("MlpPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
        before = [p.detach().clone() for p in model.policy.parameters()]
        model.learn(64)
        after = list(model.policy.parameters())
        assert any(not one.equal(two) for one, two in zip(before, after, strict=True))
        assert all(bool(p.isfinite().all()) for p in after)
