"""Training configurations: what they say, and what is refused."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from cjt_gym.baselines import make_controller
from cjt_gym.disk import to_toml
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.joint import load_joint, load_joint_file
from cjt_gym.joint import to_toml as joint_toml
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import (
    TrainConfig,
    config_names,
    environment_arguments,
    from_dict,
    load_config,
)


@pytest.mark.slow
@pytest.mark.parametrize("name", config_names())
def test_shipped_configurations_make_a_model_and_survive_a_round_trip(name: str) -> None:
    config = load_config(name)
    again = from_dict(tomllib.loads(to_toml(config.to_dict())), "text")
    assert again.to_dict() == config.to_dict()
    env = make_environment(config)
    assert make_model(config, env).observation_space == env.observation_space


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("total_stps = 10", "Unknown key 'total_stps'. Did you mean 'total_steps'"),
        ("[policy]\nnet_arc = [3]", r"'net_arc'. Did you mean 'net_arch'.*\[policy\]"),
        ("[env]\njiont = 'x'", "'jiont'. Did you mean 'joint'"),
        ("[env]\nbase_controller = 'pdd'", "Unknown controller 'pdd'"),
        ("[evaluation]\nevery = 0", "every of .evaluation. must be a whole number >= 1, got 0"),
        ("[policy]\nactivation = 'tanhh'", "'tanhh'. Did you mean 'tanh'"),
        ("algorithm = 'PPP'", "Unknown algorithm 'PPP'. Did you mean 'PPO'"),
        ("total_steps = 1.5", "total_steps must be a whole number >= 1, got 1.5"),
        ("num_envs = true", "num_envs must be a whole number"),
        ("seed = 500000", "seed must be below"),
        ("normalize_rewards = 1", "normalize_rewards must be true or false"),
        ("policy = 3", "policy of .* must be a table"),
        ("[policy]\nnet_arch = [0]", "net_arch of .policy. must list whole numbers"),
        ("[policy]\nnoise_weight = -1.0", "noise_weight of .policy. must be finite and >= 0"),
        ("[policy]\nnoise_weight = true", "noise_weight of .policy. must be finite and >= 0"),
        ("algorithm = 'SAC'\n[policy]\nnoise_weight = 1.0", "must be 0 for SAC"),
        (
            "[policy]\nnoise_weight = 1.0\n[algorithm_options]\nent_coef = 0.1",
            "ent_coef of .* must be 0 beside noise_weight",
        ),
        ("[env]\nbase_gains = { kp = 1.0 }", "base_gains of .env. must be a table"),
        ("[env]\nbase_controller = 'pd'\nbase_gains = 3", "base_gains of .env. must be a table"),
        (
            "[env]\nbase_controller = 'pd'\nbase_gains = { kq = 1.0 }",
            "Unknown gain of controller pd 'kq'. Known: kd, kp",
        ),
        (
            "[env]\nbase_controller = 'pd'\nbase_gains = { kp = 'a' }",
            "Gain kp of controller pd must be a number, got 'a'",
        ),
        ("total_steps = ", "must be a TOML file"),
    ],
)
def test_what_is_wrong_is_said(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CjtGymError, match=message):
        load_config(path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"learning_rat": 1e-3}, "Did you mean 'learning_rate'"),
        ({"gamma": {"start": 1.0, "end": 0.9}}, "gamma of .* cannot be"),
        ({"learning_rate": {"from": 1.0, "to": 0.9}}, "learning_rate of .* cannot be"),
        ({"batch_size": 1}, "do not suit PPO"),
    ],
)
def test_options_of_the_algorithm_are_checked(options: dict[str, Any], message: str) -> None:
    config = TrainConfig(num_envs=1, algorithm_options={"n_steps": 8, **options})
    with pytest.raises(ConfigurationError, match=message):
        make_model(config, make_environment(config))


def test_gains_of_the_base_replace_its_own() -> None:
    env = {"base_controller": "pd_feedforward", "base_gains": {"kd": 0.0}}
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox")
    usual = make_controller("pd_feedforward", joint, 1e-3)
    made = environment_arguments(env)["base_controller"](joint, 1e-3)
    assert made.kd == 0.0 != usual.kd
    assert made.kp == usual.kp


def test_a_file_that_does_not_exist_names_those_that_ship() -> None:
    with pytest.raises(MissingFileError, match="demo"):
        load_config("nowhere.toml")
    with pytest.raises(MissingFileError, match="Did you mean 'ppo_residual'"):
        load_config("ppo_residul")


def test_a_joint_beside_the_file_is_found(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(joint_toml(load_joint_file("lemon_50_6000")))
    (tmp_path / "config.toml").write_text('[env]\njoint = "mine.toml"\n', encoding="utf-8")
    config = load_config(tmp_path / "config.toml")
    assert Path(config.env["joint"]) == tmp_path / "mine.toml"
