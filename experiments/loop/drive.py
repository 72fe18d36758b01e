"""Run an agent on a joint of the other simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.blind.plant import World
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import ForeignEpisode
from cjt_gym.joint import Joint
from cjt_gym.plant import Limits, Measurement, limits_of
from cjt_gym.training.deploy.fast_policy import fast_policy
from cjt_gym.training.evaluation.rollout import Agent, Traces
from cjt_gym.training.learning.policy import PolicyAgent
from experiments.loop.joints import CUTOFF
from experiments.loop.live import Live, Sample

Floats = NDArray[np.float64]
FINE_STEP: Final = 2e-5
"""Step of the other simulator's integrator [s]."""


@final
class BlindPlant:
    """A joint of the other simulator behind the contract of a plant.

    Velocities are the differences of measured angles, through the low pass that policies are
    trained with.

    Attributes:
        tau: True joint torque [N m].
    """

    def __init__(self, world: World, joint: Joint, steps: int) -> None:
        """Prepare.

        Args:
            world: The joint as it is.
            joint: What is known of it: torque per ampere and limits.
            steps: Control steps of a run.
        """
        self.dt = world.sampling
        self.limits: Limits = limits_of(joint)
        self.tau = 0.0
        self._world, self._samples = world, steps + 1
        self._per_ampere = joint.parameters.k_t * joint.parameters.n
        self._rigid_gear = not world.structure.gear_is_soft
        self._weight = 1.0 - np.exp(-2.0 * np.pi * CUTOFF * self.dt)
        self.reset()

    def reset(self, seed: int | None = None) -> Measurement:
        """Start anew at rest and return the first measurement."""
        self._live = Live(self._world, self._samples, seed or 0, FINE_STEP)
        self._angles: Floats | None = None
        self._rates, self._t = np.zeros(3), 0.0
        return self._take(self._live.sample)

    def step(self, command: Floats) -> Measurement:
        """Command a motor torque [N m], shape (1,), and return the next measurement."""
        limit = self.limits.tau
        current = float(np.clip(command[0], -limit, limit)) / self._per_ampere
        self._t += self.dt
        return self._take(self._live.step(current))

    def close(self) -> None:
        """Nothing is held."""

    def _take(self, sample: Sample) -> Measurement:
        seen, self.tau = sample.measured, sample.tau
        q_g = seen["q_m"] if self._rigid_gear else seen["q_g"]
        angles = np.array([seen["q_m"], q_g, seen["q_l"]])
        if self._angles is not None:
            rates = (angles - self._angles) / self.dt
            self._rates = self._rates + self._weight * (rates - self._rates)
        self._angles = angles
        columns = np.array([self._t, seen["i"], *angles, *self._rates, seen["tau"]])[:, None]
        return Measurement(*columns)


def drive(
    agent: Agent, arguments: Mapping[str, Any], world: World, episodes: int, seed: int
) -> Traces:
    """Run an agent on a joint of the other simulator; the error counts by its true torque.

    Args:
        agent: Controller or policy to run.
        arguments: Of the environment that it was made for: its base controller suits that joint.
        world: The joint as it is.
        episodes: How many, each from rest.
        seed: Of the first; episode i has seed + i.
    """
    batch = Episodes(1, **arguments)
    task, steps = ForeignEpisode(batch), batch.settings.episode_steps
    shape, act = (episodes, steps), _function_of(agent)
    wanted, tau, measured, command = (np.zeros(shape) for _ in range(4))
    plant = BlindPlant(world, batch.settings.joint, steps)
    for j in range(episodes):
        batch.plant.seed(seed + j)
        batch.reset()
        agent.begin()
        task.begin(plant.reset(seed + j))
        for k in range(steps):
            chosen = task.choose(act(task.task.observation.copy()))
            task.advance(plant.step(chosen))
            task.conclude(float(chosen[0]))
            wanted[j, k], tau[j, k] = task.task.reference[0], plant.tau
            measured[j, k], command[j, k] = task.measured.tau[0], chosen[0]
    return Traces(wanted, tau, measured, command, np.zeros(shape, np.bool_), plant.dt)


def _function_of(agent: Agent) -> Callable[[NDArray[np.float32]], NDArray[Any]]:
    """Return what an agent does with the observation of one episode, shape (1, size)."""
    if not isinstance(agent, PolicyAgent):
        return agent.act
    policy = fast_policy(agent)
    return lambda observation: policy(observation[0])[None]
