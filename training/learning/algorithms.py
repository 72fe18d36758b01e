"""From a configuration to a Stable-Baselines3 model and its environment."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from cjt_gym.disk import parsing, whole
from cjt_gym.disk.arrays import read_arrays
from cjt_gym.envs.sb3 import JointsVecEnv, TorqueTrackingVecEnv
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint.border import checked_array
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.joint_families import arguments_of
from cjt_gym.training.learning.quiet import QuietPolicy, sensor_noise

CLASSES: dict[str, type[BaseAlgorithm]] = {
    "PPO": PPO,
    "SAC": SAC,
    "TQC": TQC,
    "RecurrentPPO": RecurrentPPO,
}
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
OURS = ("policy", "env", "seed", "device", "verbose", "tensorboard_log", "policy_kwargs")
BEGINNING = 1e-4
"""Weight of the statistics of a normalisation before its first sample [samples]."""
SCHEDULES = ("learning_rate", "clip_range")


def make_environment(config: TrainConfig) -> VecEnv:
    """Return the batch of environments of a configuration, normalised as it says.

    Torch takes the number of threads that the configuration says.
    """
    torch.set_num_threads(config.threads)
    env: VecEnv = _batch(config)
    if config.normalize_observations or config.normalize_rewards:
        gamma = float(_options(config, CLASSES[config.algorithm]).get("gamma", 0.99))
        env = VecNormalize(
            env,
            norm_obs=config.normalize_observations,
            norm_reward=config.normalize_rewards,
            gamma=gamma,
        )
    return env


def _batch(config: TrainConfig) -> VecEnv:
    joints = arguments_of(config)
    each = config.num_envs // len(joints)
    batches = [TorqueTrackingVecEnv(each, **arguments) for arguments in joints]
    return batches[0] if len(batches) == 1 else JointsVecEnv(batches)


def make_model(config: TrainConfig, env: VecEnv) -> BaseAlgorithm:
    """Return the model of a configuration, not yet trained."""
    algorithm = CLASSES[config.algorithm]
    options = _options(config, algorithm)
    network: dict[str, Any] = {
        "net_arch": list(config.policy.net_arch),
        "activation_fn": ACTIVATIONS[config.policy.activation],
    }
    recurrent = config.algorithm == "RecurrentPPO"
    if recurrent or config.algorithm == "PPO":
        network["log_std_init"] = config.policy.log_std_init
    if recurrent:
        network["lstm_hidden_size"] = config.policy.lstm_hidden_size
    policy: str | type[ActorCriticPolicy] = "MlpLstmPolicy" if recurrent else "MlpPolicy"
    weight = config.policy.noise_weight
    if weight > 0.0:
        policy, options = QuietPolicy, options | {"ent_coef": weight}
    try:
        model = algorithm(
            policy,
            env,
            seed=config.seed,
            device=config.device,
            policy_kwargs=network,
            **options,
        )
    except (TypeError, ValueError, AssertionError, RuntimeError) as error:
        raise ConfigurationError(
            f"[algorithm_options] or device do not suit {config.algorithm}: {error}"
        ) from error
    if isinstance(model.policy, QuietPolicy):
        model.policy.listen(lambda: sensor_noise(config), env)
    return model


def _options(config: TrainConfig, algorithm: type[BaseAlgorithm]) -> dict[str, Any]:
    known = [n for n in inspect.signature(algorithm).parameters if n not in OURS]
    options = dict(config.algorithm_options)
    for name, value in options.items():
        if name not in known:
            where = f"(in [algorithm_options] for {config.algorithm})"
            raise ConfigurationError(f"{unknown_name('option', name, known)} {where}")
        if isinstance(value, Mapping):
            options[name] = _schedule(name, value)
    return _no_longer_than_the_training(options, config, algorithm)


def _no_longer_than_the_training(
    options: dict[str, Any], config: TrainConfig, algorithm: type[BaseAlgorithm]
) -> dict[str, Any]:
    """Return options whose rollouts take no more steps than the training has."""
    if not issubclass(algorithm, OnPolicyAlgorithm):
        return options
    usual = inspect.signature(algorithm).parameters
    n_steps = math.ceil(max(config.total_steps, 2) / config.num_envs)
    if n_steps >= options.get("n_steps", usual["n_steps"].default):
        return options
    size, batch = n_steps * config.num_envs, options.get("batch_size", usual["batch_size"].default)
    return options | {"n_steps": n_steps, "batch_size": size if size % batch else batch}


def steps_of(model: BaseAlgorithm, total: int) -> int:
    """Return how many steps a model is at after learning up to a total, in whole rollouts."""
    each = model.n_envs * (model.n_steps if isinstance(model, OnPolicyAlgorithm) else 1)
    done = model.num_timesteps
    return done + math.ceil(max(total - done, 0) / each) * each


def _schedule(name: str, ends: Mapping[str, Any]) -> Callable[[float], float]:
    """Return the linear schedule over a training, of the share that remains."""
    if name not in SCHEDULES or sorted(ends) != ["end", "start"]:
        raise ConfigurationError(
            f"{name} of [algorithm_options] cannot be {dict(ends)}; only "
            f"{' and '.join(SCHEDULES)} can be a schedule, {{ start = ..., end = ... }}."
        )
    start, end = float(ends["start"]), float(ends["end"])
    return lambda remaining: end + (start - end) * remaining


def load_weights(model: BaseAlgorithm, path: Path) -> None:
    """Read the weights of networks and optimiser, and nothing but numbers, into a model."""
    with parsing(f"{path} must hold the weights of this network", ConfigurationError):
        model.set_parameters(str(path), device=model.device)


def save_normalization(env: VecEnv, path: Path) -> None:
    """Write the running statistics of an environment, if it has any, as NPZ."""
    if isinstance(env, VecNormalize):
        arrays = {"return_mean": env.ret_rms.mean, "return_var": env.ret_rms.var}
        arrays |= {"return_count": np.array(env.ret_rms.count)}
        if env.norm_obs:
            statistics: Any = env.obs_rms
            arrays |= {"observation_mean": statistics.mean, "observation_var": statistics.var}
            arrays |= {"observation_count": np.array(statistics.count)}
        with whole(path) as part:
            np.savez(part, **arrays)  # type: ignore[arg-type]


def observation_scaling(env: VecNormalize) -> tuple[Floats, Floats]:
    """Return what observations are shifted by and then multiplied with, each of shape (size,).

    An input that never varied in training is multiplied with zero. Its statistics hold no scale,
    and what stands in their place would turn the smallest deviation into a large one.
    """
    statistics: Any = env.obs_rms
    # Statistics begin with a variance of one and a mean of zero, as heavy as BEGINNING samples.
    left = BEGINNING * (1.0 + statistics.mean**2)
    untouched = statistics.count <= BEGINNING
    varied = untouched | (statistics.var * statistics.count > 2.0 * left)
    scale = np.where(varied, 1.0 / np.sqrt(statistics.var + env.epsilon), 0.0)
    return np.asarray(statistics.mean), scale


def load_normalization(env: VecEnv, path: Path) -> None:
    """Read what `save_normalization` wrote into an environment."""
    if not isinstance(env, VecNormalize):
        return
    arrays = read_arrays(path, ConfigurationError)
    kinds: list[tuple[str, Any]] = [("return", env.ret_rms)]
    kinds += [("observation", env.obs_rms)] if env.norm_obs else []
    with parsing(f"{path} must hold statistics of this environment", ConfigurationError):
        for kind, statistics in kinds:
            shape = np.shape(statistics.mean)
            mean, var = (
                checked_array(f"{kind}_{name} of {path}", arrays[f"{kind}_{name}"], shape)
                for name in ("mean", "var")
            )
            if (var < 0.0).any():
                raise ValueError(f"{kind}_var is negative")
            statistics.mean, statistics.var = mean, var
            statistics.count = float(arrays[f"{kind}_count"])
