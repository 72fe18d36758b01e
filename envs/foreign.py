"""Episodes on a joint that something else moves: a real one, or another program's simulation.

The episode keeps reference, observation and reward, and sees of the joint what is measured.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.core import Episodes, report_of
from cjt_gym.envs.observe import Seen, draw_episodes
from cjt_gym.envs.step import begin_seen, conclude_seen
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Measurement

EVERYONE = np.ones(1, dtype=np.bool_)
"""The mask of a batch of one."""


class ForeignEpisode:
    """One episode after the other on such a joint.

    A step is `choose`, then the joint moves, then `advance` with what it measures, and `conclude`.
    The task is that of a batch of one whose simulated joint stands still.
    """

    def __init__(self, episodes: Episodes) -> None:
        self.episodes, self.task = episodes, episodes.task
        self.measured = episodes.plant.measurement()
        self.steps = 0

    def begin(self, measured: Measurement) -> None:
        """Begin an episode where the joint stands, with its first measurement."""
        draw_episodes(self.episodes.plant.batch.arrays.rng, self.task, EVERYONE)
        self.measured, self.steps = measured, 0
        begin_seen(self.task, self._seen())
        if self.episodes.controller is not None:
            self.episodes.controller.reset(EVERYONE)

    def choose(self, action: NDArray[np.floating[Any]]) -> Floats:
        """Return the motor torque that an action and the base controller command, (1,) [N m].

        The action, shape (1, 1), is clipped to [-1, 1].
        """
        return self.episodes.choose(action, self.measured)

    def advance(self, measured: Measurement) -> None:
        """Take what the joint measures a control step later; `conclude` ends the step."""
        self.measured = measured
        self.steps += 1

    def conclude(self, command: float) -> None:
        """Observe and reward a step in which a motor torque was commanded [N m]."""
        conclude_seen(self.task, self._seen(), float(command))
        self.episodes.take_own_reward(self._told())

    def rehearse(self) -> None:
        """Do once what a step does, so that nothing is compiled while the joint moves."""
        self.begin(self.measured)
        self.conclude(float(self.choose(np.zeros((1, 1)))[0]))
        self.info()

    def info(self) -> dict[str, float]:
        """Return what a step reports; the measured torque stands for the true one."""
        return {name: float(x[0]) for name, x in self._told().items()}

    def _told(self) -> dict[str, Floats]:
        tau = self.measured.tau
        return report_of(self.episodes, tau, tau)

    def _seen(self) -> Seen:
        q_m, dq_m, dq_l, tau = (
            float(getattr(self.measured, name)[0]) for name in ("q_m", "dq_m", "dq_l", "tau")
        )
        return Seen(self.steps, q_m, dq_m, dq_l, tau, tau, dq_m)
