"""Episodes on a plant that is not their own: a real joint, or another program's simulation.

The episodes keep reference, observation and reward; what moves is somewhere else, and they see of
it only what is measured.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.observe import begin, conclude, draw_episodes
from cjt_gym.joint.arrays import CHANNELS, DQ_M, TAU
from cjt_gym.plant import Measurement

EVERYONE = np.ones(1, dtype=np.bool_)
"""The mask of a batch of one."""


def begin_on(episodes: Episodes, measured: Measurement) -> None:
    """Begin an episode where the plant stands.

    Args:
        episodes: A batch of one.
        measured: The plant's first measurement.
    """
    arrays = episodes.plant.batch.arrays
    draw_episodes(arrays, episodes.task, EVERYONE)
    arrays.samples[:] = 0
    _show(episodes, measured)
    begin(arrays, episodes.task, EVERYONE)
    if episodes.controller is not None:
        episodes.controller.reset(EVERYONE)


def advance_on(episodes: Episodes, measured: Measurement) -> None:
    """Take over what the plant measures a control step later; `conclude_on` ends the step."""
    episodes.plant.batch.arrays.samples[:] += 1
    _show(episodes, measured)


def conclude_on(episodes: Episodes, command: NDArray[np.float64]) -> None:
    """Observe and reward a step.

    Args:
        episodes: A batch of one.
        command: Motor torque that was commanded, shape (1,) [N m].
    """
    conclude(episodes.plant.batch.arrays, episodes.task, command)
    episodes.take_own_reward()


def _show(episodes: Episodes, measured: Measurement) -> None:
    """Put a measurement where the task looks for it; measured is all there is."""
    arrays = episodes.plant.batch.arrays
    for j, name in enumerate(CHANNELS):
        arrays.measured[0, j] = getattr(measured, name)[0]
    arrays.tau[0] = arrays.measured[0, TAU]
    arrays.state[0, 3] = arrays.measured[0, DQ_M]
