"""Hyperparameters for rl-zoo3.

    python -m rl_zoo3.train --algo ppo -conf cjt_gym.training.learning.zoo

What it reads is `hyperparams`: the recipe `quiet_residual` in the words of rl-zoo3, so that there
is one place for the values. `--env CJT/TorqueTracking-v0 --gym-packages cjt_gym` go with it. The
penalty on noise (`noise_weight`) is none of PPO's options and is left out: such a policy shakes
more.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cjt_gym.training.learning.algorithms import ACTIVATIONS
from cjt_gym.training.learning.config import TrainConfig, environment_arguments, load_config

ENVIRONMENT = "CJT/TorqueTracking-v0"
RECIPE = "quiet_residual"


def in_words_of_rl_zoo3(config: TrainConfig) -> dict[str, Any]:
    """Return the hyperparameters of a PPO configuration as rl-zoo3 takes them.

    A learning rate that falls does so to zero there, instead of to its `end`.
    """
    options = dict(config.algorithm_options)
    rate = options.get("learning_rate")
    if isinstance(rate, Mapping):
        options["learning_rate"] = f"lin_{rate['start']}"
    arguments = environment_arguments(config.env)
    return {
        "n_timesteps": config.total_steps,
        "n_envs": config.num_envs,
        "policy": "MlpPolicy",
        "policy_kwargs": {
            "net_arch": list(config.policy.net_arch),
            "activation_fn": ACTIVATIONS[config.policy.activation],
            "log_std_init": config.policy.log_std_init,
        },
        "normalize": {
            "norm_obs": config.normalize_observations,
            "norm_reward": config.normalize_rewards,
        },
        "env_kwargs": arguments,
        **options,
    }


hyperparams = {ENVIRONMENT: in_words_of_rl_zoo3(load_config(RECIPE))}
