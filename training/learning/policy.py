"""A trained policy as an agent: observations in, actions out, for a batch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.observation import Layout
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.learning.algorithms import (
    load_normalization,
    load_weights,
    make_environment,
    make_model,
    observation_scaling,
)
from cjt_gym.training.learning.config import DatasheetsConfig, TrainConfig, environment_arguments
from cjt_gym.training.learning.policy_arguments import Trained
from cjt_gym.training.learning.run_folder import open_run


@dataclass(frozen=True)
class PolicyAgent(Trained):
    """A trained policy."""

    name: str
    config: TrainConfig  # how it was trained
    layout: Layout  # what its observation is made of
    model: BaseAlgorithm  # the Stable-Baselines3 model
    normalizer: VecNormalize | None  # environment whose statistics scale its observations, or None
    _memory: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return the deterministic actions, shape (episodes, 1)."""
        if self.normalizer is not None:
            mean, scale = observation_scaling(self.normalizer)
            most = self.normalizer.clip_obs
            observation = np.clip((observation - mean) * scale, -most, most).astype(np.float32)
        memory = self._memory
        first = None if memory else np.ones(len(observation), dtype=np.bool_)
        actions, state = self.model.predict(
            observation, memory.get("state"), first, deterministic=True
        )
        if state is not None:  # recurrent policies alone have one
            memory["state"] = state
        return actions

    def begin(self) -> None:
        """Forget what a recurrent policy remembers."""
        self._memory.clear()


def load_policy(run: str | Path, checkpoint: Path | None = None) -> PolicyAgent:
    """Return the policy of a run.

    Only weights are read from its files: network and options come from `config.toml`.

    Args:
        run: The run folder.
        checkpoint: Folder of one of its checkpoints, instead of the best model.

    Raises:
        MissingFileError: There is no such folder.
        ConfigurationError: It is not a run of cjt-gym, or has no model yet.
    """
    folder = open_run(run)
    files = checkpoint or folder.path
    if not (files / "model.zip").is_file():
        raise ConfigurationError(
            f"{run} has no model yet (status: {folder.facts['status']}). Continue the training:  "
            f"cjt-gym train {folder.path / 'config.toml'} --out {run}"
        )
    config = replace(folder.config, device="cpu")
    env = make_environment(replace(config, datasheets=DatasheetsConfig()))
    model = make_model(config, env)
    load_weights(model, files / "model.zip")
    if isinstance(env, VecNormalize):
        load_normalization(env, files / "normalization.npz")
        env.training = False
    return agent_of(folder.path.name, config, model, env)


def agent_of(name: str, config: TrainConfig, model: BaseAlgorithm, env: Any) -> PolicyAgent:
    """Return the agent of a model and the environment it is trained in."""
    scaled = isinstance(env, VecNormalize) and env.norm_obs
    layout = Episodes(1, **environment_arguments(config.env)).settings.layout
    return PolicyAgent(name, config, layout, model, env if scaled else None)
