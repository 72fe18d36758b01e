"""A trained policy as an agent: observations in, actions out, for a batch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.algorithms import load_normalization, make_environment, make_model
from cjt_gym.training.conditions import Conditions
from cjt_gym.training.config import TrainConfig, environment_arguments
from cjt_gym.training.run_folder import open_run

SCALES = ("torque_amplitude", "velocity_scale", "action_scale")
CONDITIONS = ("joint", "structure", "drive", "effects", "randomization", "dt_physics")


@dataclass(frozen=True)
class PolicyAgent:
    """A trained policy.

    Attributes:
        name: Its name in tables.
        config: How it was trained; its observation follows from that.
        model: The Stable-Baselines3 model.
        normalizer: Environment whose statistics scale its observations, or None.
    """

    name: str
    config: TrainConfig
    model: BaseAlgorithm
    normalizer: VecNormalize | None

    @property
    def kind(self) -> str:
        """Either "residual", on a base controller, or "learned"."""
        return "learned" if self.config.env.get("base_controller") is None else "residual"

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the observation and the action that it was trained with.

        On another joint than its own, torques and velocities are scaled as is usual for that one.

        Raises:
            ConfigurationError: The control step is another one.
        """
        arguments = environment_arguments(self.config.env)
        if abs(arguments["dt_control"] - conditions.dt_control) > 1e-12:
            raise ConfigurationError(
                f"The policy {self.name} was trained at dt_control = {arguments['dt_control']:g} "
                f"s and cannot run at {conditions.dt_control:g} s."
            )
        trained = Episodes(1, **arguments).settings
        given = {name: getattr(conditions, name) for name in CONDITIONS}
        arguments |= {**given, "parameters": None, "disturbance": None}
        arguments["history"] = trained.history
        if (arguments["joint"], arguments["structure"]) == self.trained_on:
            arguments |= {name: getattr(trained, name) for name in SCALES}
        return arguments

    @property
    def renders(self) -> bool:
        """False: it follows a torque."""
        return False

    @property
    def trained_on(self) -> tuple[str, str]:
        """Joint and structure that it was trained on."""
        arguments = environment_arguments(self.config.env)
        return arguments["joint"], arguments["structure"]

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return the deterministic actions, shape (episodes, 1)."""
        if self.normalizer is not None:
            scaled = self.normalizer.normalize_obs(observation)
            assert isinstance(scaled, np.ndarray)
            observation = scaled.astype(np.float32)
        actions, _ = self.model.predict(observation, deterministic=True)
        return actions


def load_policy(run: str | Path, checkpoint: Path | None = None) -> PolicyAgent:
    """Return the policy of a run.

    Only weights are read from its files: network and options come from `config.toml`.

    Args:
        run: The run folder.
        checkpoint: Folder of one of its checkpoints, instead of the best model.

    Raises:
        MissingFileError: There is no such folder.
        ConfigurationError: It is not a run of ours, or has no model yet.
    """
    folder = open_run(run)
    files = checkpoint or folder.path
    if not (files / "model.zip").is_file():
        raise ConfigurationError(
            f"{run} has no model yet (status: {folder.facts['status']}). Continue the training:  "
            f"cjt-gym train {folder.path / 'config.toml'} --out {run}"
        )
    config = replace(folder.config, device="cpu")
    env = make_environment(config)
    model = make_model(config, env)
    model.set_parameters(str(files / "model.zip"), device="cpu")
    if isinstance(env, VecNormalize):
        load_normalization(env, files / "normalization.npz")
        env.training = False
    return agent_of(folder.path.name, config, model, env)


def agent_of(name: str, config: TrainConfig, model: BaseAlgorithm, env: Any) -> PolicyAgent:
    """Return the agent of a model and the environment it is trained in."""
    scaled = isinstance(env, VecNormalize) and env.norm_obs
    return PolicyAgent(name, config, model, env if scaled else None)
