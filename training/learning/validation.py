"""The validation episodes of a training, on which policies and controllers are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cjt_gym.envs.core import Episodes
from cjt_gym.training.evaluation.metrics import rmse
from cjt_gym.training.evaluation.rollout import Agent, run_episodes
from cjt_gym.training.learning.config import VALIDATION_SEEDS, TrainConfig, environment_arguments
from cjt_gym.training.learning.joint_families import datasheets

JOINTS = 8  # of other datasheets at most, which share the episodes


def validation_error(
    config: TrainConfig, agent: Agent, changes: Mapping[str, Any] | None = None
) -> float:
    """Return the error of an agent on episodes that the training does not see [N m].

    With [datasheets], these are on joints of other datasheets than those of the training; their
    errors over their amplitudes, times that of the joint of [env].

    Args:
        config: The training. Its [env] has the base controller on which the agent acts, so that an
            agent that always gives zero has the error of that controller alone.
        agent: Policy to evaluate.
        changes: Arguments of the environment to replace, such as another base controller.
    """
    own, episodes = environment_arguments(config.env), config.evaluation.episodes
    changed = dict(changes or {})
    if config.datasheets.count == 0:
        return rmse(run_episodes(agent, own | changed, episodes, VALIDATION_SEEDS))
    joints = datasheets(config, VALIDATION_SEEDS, min(config.datasheets.count, JOINTS))
    each = math.ceil(episodes / len(joints))
    squares = [
        (rmse(run_episodes(agent, arguments | changed, each, VALIDATION_SEEDS)) / amplitude) ** 2
        for arguments in joints
        for amplitude in [arguments["torque_amplitude"]]
    ]
    amplitude = Episodes(1, **own).settings.layout.torque
    return float(amplitude * np.sqrt(np.mean(squares)))
