"""Policies for many joints: drawn datasheets, what of them is observed, and batches of joints."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import cjt_gym  # noqa: F401  (registers the environments)
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.sb3 import JointsVecEnv, TorqueTrackingVecEnv
from cjt_gym.envs.settings import joint_numbers
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import load_joint
from cjt_gym.training.deploy.export import export_policy
from cjt_gym.training.evaluation.conditions import realistic_conditions
from cjt_gym.training.evaluation.rollout import run_episodes
from cjt_gym.training.learning.algorithms import make_environment
from cjt_gym.training.learning.config import DatasheetsConfig, TrainConfig, load_config
from cjt_gym.training.learning.joint_families import arguments_of, datasheets
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.quiet import sensor_noise
from cjt_gym.training.learning.train import train


def many(config: TrainConfig, count: int = 2, **ranges: Any) -> TrainConfig:
    return replace(
        config,
        env={**config.env, "observe_joint": True},
        datasheets=DatasheetsConfig(count=count, **ranges),
    )


def test_the_numbers_are_those_of_the_datasheet() -> None:
    joint = load_joint("orange_80_6000", effects={"noise": {}, "coulomb": {}})
    f = math.sqrt(6000.0 / (0.23 + 0.0717)) / (2.0 * math.pi)
    friction, noise = 2.64 + 3.28, 0.08485281374238572
    expected = (math.log(f / 20.0), (20.0 / f) ** 2, friction / 10.0, noise / 10.0)
    assert joint_numbers(joint, 10.0) == pytest.approx(expected)
    with pytest.raises(ConfigurationError, match="observe_joint must be False .* without a spring"):
        joint_numbers(load_joint("orange_80_6000", structure="rigid"), 10.0)


def test_they_end_every_observation_and_change_nothing_else() -> None:
    arguments = {"joint": "lemon_50_6000", "effects": ["noise"], "history": 5}
    plain = gym.make("CJT/TorqueTracking-v0", **arguments)  # type: ignore[arg-type]
    told = gym.make("CJT/TorqueTracking-v0", **arguments, observe_joint=True)  # type: ignore[arg-type]
    rows = [env.reset(seed=3)[0] for env in (plain, told)]
    numbers = rows[1][-4:]
    assert numbers[0] == pytest.approx(math.log(45.0 / 20.0), abs=0.01)
    for _ in range(30):
        np.testing.assert_array_equal(rows[0], rows[1][:-4])
        np.testing.assert_array_equal(rows[1][-4:], numbers)
        action = np.array([0.3], dtype=np.float32)
        rows = [env.step(action)[0] for env in (plain, told)]


@pytest.mark.slow
def test_drawn_joints_are_what_was_drawn(tiny: TrainConfig) -> None:
    config = many(tiny, frequency=(10.0, 100.0), friction=(0.1, 0.3), noise=(0.004, 0.02))
    found = [Episodes(1, **arguments).settings for arguments in datasheets(config, 5, 6)]
    frequencies = [20.0 * math.exp(s.layout.joint_numbers[0]) for s in found]
    edges = np.geomspace(10.0, 100.0, 7)
    assert all(a <= f <= b for f, a, b in zip(frequencies, edges, edges[1:], strict=False))
    assert all(0.1 <= s.layout.joint_numbers[2] <= 0.3 + 1e-9 for s in found)
    assert all(0.004 - 1e-9 <= s.layout.joint_numbers[3] <= 0.02 + 1e-9 for s in found)
    own = Episodes(1, **arguments_of(tiny)[0]).settings
    assert {s.layout.torque for s in found} == {own.layout.torque}
    for s in found:  # the speed that stretches the spring at 20 Hz, and what it resolves
        assert s.layout.velocity * s.joint.parameters.k_b == pytest.approx(
            own.layout.velocity * own.joint.parameters.k_b
        )
        assert s.layout.action == pytest.approx(own.layout.action)
        assert s.joint.effects["noise"]["q_m"] * s.joint.parameters.k_b == pytest.approx(
            own.joint.effects["noise"]["q_m"] * own.joint.parameters.k_b
        )
    assert datasheets(config, 5, 6)[2]["parameters"] == datasheets(config, 5, 6)[2]["parameters"]
    assert datasheets(config, 6, 6)[2]["parameters"] != datasheets(config, 5, 6)[2]["parameters"]


def test_with_much_friction_the_references_grow(tiny: TrainConfig) -> None:
    config = many(tiny, friction=(0.5, 0.5))
    settings = Episodes(1, **datasheets(config, 0, 1)[0]).settings
    own = Episodes(1, **arguments_of(tiny)[0]).settings
    assert settings.layout.torque == pytest.approx(1.5 * own.layout.torque)
    grown = [signal.amplitude for signal in settings.references]
    assert grown == pytest.approx([1.5 * signal.amplitude for signal in own.references])


def test_batches_as_one_are_the_batches(tiny: TrainConfig) -> None:
    arguments = arguments_of(many(tiny))
    whole = JointsVecEnv(
        [TorqueTrackingVecEnv(n, **a) for n, a in zip((3, 2), arguments, strict=True)]
    )
    parts = [TorqueTrackingVecEnv(n, **a) for n, a in zip((3, 2), arguments, strict=True)]
    whole.seed(11)
    seen = whole.reset()
    for part, first in zip(parts, (11, 14), strict=True):
        part.seed(first)
    np.testing.assert_array_equal(seen, np.concatenate([part.reset() for part in parts]))
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(70):
        actions = rng.uniform(-1.0, 1.0, size=(5, 1)).astype(np.float32)
        seen, rewards, dones, infos = whole.step(actions)
        steps = [part.step(a) for part, a in zip(parts, (actions[:3], actions[3:]), strict=True)]
        np.testing.assert_array_equal(seen, np.concatenate([step[0] for step in steps]))
        np.testing.assert_array_equal(rewards, np.concatenate([step[1] for step in steps]))
        ended += int(dones.sum())
        assert [("episode" in info) for info in infos] == list(dones)
    assert ended >= 5
    assert whole.get_attr("num_envs") == [3, 3, 3, 2, 2]


def test_the_noise_is_that_of_each_joint(tiny: TrainConfig) -> None:
    config = many(tiny, frequency=(15.0, 15.0), noise=(0.003, 0.03))
    noise = sensor_noise(config)
    assert noise.rows.shape[0] == len(noise.torque) == 2
    told = noise.numbers[:, 3] * noise.amplitude
    assert noise.torque == pytest.approx(told, rel=0.1)
    np.testing.assert_allclose(noise.rows[..., -4:], 0.0, atol=1e-5)
    assert noise.commands[-1] == noise.rows.shape[-1] - 5


@pytest.mark.slow
def test_a_policy_for_many_joints_learns_is_validated_and_runs_exported(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    config = many(tiny)
    config = replace(config, policy=replace(config.policy, noise_weight=0.1))
    run = train(config, tmp_path / "many", quiet=True)
    assert [row["steps"] for row in run.progress()] == [1024, 2048]
    agent = load_policy(run.path)
    assert agent.model.observation_space.shape == make_environment(config).observation_space.shape
    for joint in ("orange_80_6000", "lemon_50_6000"):
        arguments = agent.arguments(realistic_conditions(joint)) | {"episode_steps": 40}
        traces = run_episodes(agent, arguments, 2, 0)
        assert np.all(np.isfinite(traces.tau))
    written = export_policy(run.path, "numpy", tmp_path / "policy.npz")
    assert written.checked.steps > 0
    assert written.checked.error < 1e-4


def test_bad_settings_are_refused(tiny: TrainConfig) -> None:
    with pytest.raises(ConfigurationError, match="observe_joint of .* must be true"):
        replace(tiny, datasheets=DatasheetsConfig(count=2))
    with pytest.raises(
        ConfigurationError, match="num_envs must be a multiple of count .* 3, got 8"
    ):
        many(tiny, count=3)
    with pytest.raises(ConfigurationError, match="frequency of .* lowest and highest, >= 1.0"):
        DatasheetsConfig(frequency=(30.0, 10.0))
    with pytest.raises(ConfigurationError, match="count of .* whole number >= 0, got -1"):
        DatasheetsConfig(count=-1)


def test_the_recipe_for_many_joints_is_valid() -> None:
    config = load_config("universal_residual")
    assert config.datasheets.count > 1
    joints = [Episodes(1, **a).settings.layout.joint_numbers for a in datasheets(config, 0, 4)]
    assert len(set(joints)) == 4
