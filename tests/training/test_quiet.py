"""The penalty on what the sensors' noise does to the command of a policy and its base."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from cjt_gym.errors import ConfigurationError
from cjt_gym.training.deploy.export import export_policy
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.quiet import QuietPolicy, SensorNoise, sensor_noise
from cjt_gym.training.learning.train import train


def with_weight(config: TrainConfig, weight: float) -> TrainConfig:
    return replace(config, policy=replace(config.policy, noise_weight=weight))


def policy_of(config: TrainConfig) -> QuietPolicy:
    policy = make_model(config, make_environment(config)).policy
    assert isinstance(policy, QuietPolicy)
    return policy


def one_joint(noise: SensorNoise) -> SimpleNamespace:
    """Return the noise on the only joint of a training, without the axis of joints."""
    assert len(noise.rows) == 1
    first = {name: getattr(noise, name)[0] for name in ("rows", "base", "torque", "action")}
    return SimpleNamespace(**first, amplitude=noise.amplitude[0], commands=noise.commands)


def test_noise_is_that_of_the_sensors(tiny: TrainConfig) -> None:
    noise = one_joint(sensor_noise(tiny))
    config = make_environment(tiny).get_attr("episodes")[0].settings.layout
    head = config.preview + 4
    assert noise.rows.shape[2] == head + 4 * config.history
    assert list(noise.commands) == list(range(head + 3, noise.rows.shape[2], 4))
    scatter = noise.rows.std(axis=(0, 1))
    assert scatter[head] * config.torque == pytest.approx(noise.torque, rel=0.05)
    assert np.all(scatter[head::4] == pytest.approx(scatter[head], rel=0.1))
    assert scatter[0] == 0.0  # the reference
    shares = noise.amplitude / noise.action * noise.rows[1:, :, noise.commands[0]]
    shares -= shares.mean(axis=0)
    before = noise.base[:-1] - noise.base[:-1].mean(axis=0)
    np.testing.assert_allclose(shares, before, atol=1e-5)
    assert before.std() > 0.0
    assert np.allclose(noise.rows[..., config.preview + 1], -noise.rows[..., head], atol=1e-6)


def test_a_torque_sensor_without_noise_cannot_set_a_penalty(tiny: TrainConfig) -> None:
    config = with_weight(replace(tiny, env={**tiny.env, "effects": {}}), 1.0)
    with pytest.raises(ConfigurationError, match="noise_weight of .* no noise, got 1"):
        sensor_noise(config)


def test_without_past_commands_the_penalty_is_that_of_the_sensors_alone(tiny: TrainConfig) -> None:
    config = with_weight(tiny, 0.1)
    policy, noise = policy_of(config), one_joint(sensor_noise(config))
    size = noise.rows.shape[2]
    with torch.no_grad():
        for name, weights in policy.mlp_extractor.policy_net.named_parameters():
            if name == "0.weight":
                weights[:, noise.commands] = 0.0
        found = float(policy.penalty(torch.zeros(4000, size)))
        mean = policy.get_distribution(torch.zeros(1, size)).mode()
        there = policy.get_distribution(torch.as_tensor(noise.rows.reshape(-1, size))).mode()
    shaken = (there - mean).flatten() + torch.as_tensor(noise.base.reshape(-1))
    expected = float(shaken.square().mean()) * (noise.action / noise.torque) ** 2
    assert found == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("feedback", [0.0, 0.9, -0.9])
def test_the_penalty_is_how_much_a_joint_at_rest_shakes(tiny: TrainConfig, feedback: float) -> None:
    config = with_weight(
        replace(tiny, env={**tiny.env, "base_controller": None}, normalize_observations=False), 0.1
    )
    env = make_environment(config)
    policy, noise = policy_of(config), one_joint(sensor_noise(config))
    held = env.get_attr("episodes")[0].settings.layout
    with torch.no_grad():  # a linear law: the measured torque and the command before it
        gain, shrunk = 0.5 * noise.amplitude / noise.action, 1e-3
        for name, weights in policy.mlp_extractor.policy_net.named_parameters():
            weights.zero_()
            if name == "0.weight":
                weights[0, held.preview + 4] = gain * shrunk
                weights[0, noise.commands[0]] = feedback * noise.amplitude / noise.action * shrunk
        policy.action_net.weight.zero_()
        policy.action_net.weight[0, 0] = 1.0 / shrunk
        found = float(policy.penalty(torch.zeros(2000, noise.rows.shape[2]))) ** 0.5
    assert found == pytest.approx(0.5 / (1.0 - feedback**2) ** 0.5, rel=0.15)


def test_a_weight_quietens_the_policy_and_what_is_exported(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    alone = replace(tiny, env={**tiny.env, "base_controller": None})
    loud = train(alone, tmp_path / "loud", quiet=True)
    run = train(with_weight(alone, 10.0), tmp_path / "quiet", quiet=True)
    policy = policy_of(with_weight(alone, 10.0))
    places = torch.zeros(500, policy.observation_space.shape[0])  # type: ignore[index]
    shaken = []
    with torch.no_grad():
        for folder in (run.path, loud.path):
            policy.load_state_dict(load_policy(folder).model.policy.state_dict())
            shaken.append(float(policy.penalty(places)) ** 0.5)
    assert shaken[0] < 0.7 * shaken[1]
    written = export_policy(run.path, "numpy", tmp_path / "policy.npz")
    assert written.checked.steps > 0
