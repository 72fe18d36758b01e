"""A policy for PPO that pays for what the noise of the sensors does to the command.

With m the mean action, o an observation, d[t] what the sensors' noise does to it at rest, and b[t]
what it does to the command of the base controller,

    u[t] = m(o + d[t] + h[t]) - m(o),

where h[t] are u[t-1], u[t-2], ... at the places of the past commands, which hold those of the base
already: how much the command varies while the joint, held by its friction, does not answer. The
penalty is the mean square of u + b. It is a smoothness in space as in Mysore et al., 2021,
Regularizing Action Policies for Smooth Control, with noise that is not white and in a loop: without
the loop, policies learn to ring in their past commands. Unlike a reward for small changes of the
command it leaves the answer to the reference free, and its gradient is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import PyTorchObs
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.settings import Settings
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.evaluation.conditions import zero_reference
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.joint_families import arguments_of

EPISODES, FEWEST, SETTLE, STEPS, SEED = 64, 4, 50, 256, 0
"""Of the recorded rest: episodes in all and at least per joint, control steps that do not count and
that do, and the seed."""
PLACES, LENGTH, EVERY = 32, 32, 4
"""How many loops are followed, for how many steps, of which the second half counts, and in which
share of the minibatches; their penalties stand for those of the others."""


@dataclass(frozen=True)
class SensorNoise:
    """What the sensors' noise does to observations at rest, on each joint of a training."""

    # deviations of observations from their mean, shape (joints, steps, episodes, size)
    rows: NDArray[np.float32]
    # those of the base controller's command that answers each, over `action`, shape (joints, steps,
    # episodes)
    base: NDArray[np.float32]
    # standard deviation of the measured torque from the true one, shape (joints,) [N m]
    torque: NDArray[np.float64]
    action: NDArray[np.float64]  # motor torque of an action of 1, shape (joints,) [N m]
    amplitude: NDArray[np.float64]  # torque that observations are divided by, shape (joints,) [N m]
    # what of the datasheets ends observations, shape (joints, numbers)
    numbers: NDArray[np.float32]
    # where an observation holds the past commands, newest first, shape (history,)
    commands: NDArray[np.int64]


def sensor_noise(config: TrainConfig) -> SensorNoise:
    """Return the noise on the observations of a configuration, of joints at rest.

    The base controller acts, with a reference of zero; the policy does not.
    """
    joints = arguments_of(config)
    episodes = max(FEWEST, EPISODES // len(joints))
    heard = [_listen(arguments, episodes) for arguments in joints]
    rows, base, torque, settings = zip(*heard, strict=True)
    if min(torque) == 0.0:
        raise ConfigurationError(
            "noise_weight of [policy] must be 0 where the torque sensor has no noise, got "
            f"{config.policy.noise_weight}. Set it to 0, or add noise to [env.effects]."
        )
    return SensorNoise(
        np.stack(rows),
        np.stack(base),
        np.array(torque),
        np.array([s.layout.action for s in settings]),
        np.array([s.layout.torque for s in settings]),
        np.array([s.layout.joint_numbers for s in settings], np.float32),
        np.flatnonzero(np.array(settings[0].layout.names()) == "command"),
    )


def _listen(
    arguments: Mapping[str, Any], count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], float, Settings]:
    """Return deviations of observations and of the base's actions, and the torque's noise."""
    s = Episodes(1, **arguments).settings
    here = dict(arguments) | s.layout.scales() | {"history": s.layout.history}
    here |= {"reference": zero_reference(), "disturbance": None, "episode_steps": SETTLE + STEPS}
    episodes = Episodes(count, **here)
    episodes.seed(SEED, None)
    episodes.reset()
    seen, answers, off = [], [], []
    for step in range(SETTLE + STEPS):
        before = episodes.task.observation.copy()
        episodes.step(np.zeros((count, 1)))
        if step >= SETTLE:
            seen.append(before)
            answers.append(episodes.task.command / s.layout.action)
            told = episodes.info()
            off.append(told["tau_measured"] - told["tau"])
    rows, base = (np.array(x, np.float32) for x in (seen, answers))
    rows -= rows.mean(axis=0)
    base -= base.mean(axis=0)
    return rows, base, float(np.mean(np.std(off, axis=0))), s


class QuietPolicy(ActorCriticPolicy):
    """An actor and a critic; where PPO has the entropy in its loss, this has minus the penalty.

    So `ent_coef` is the penalty's weight. The penalty is the square of an amplification: of how
    much the command shakes over the torque sensor's noise.
    """

    _noise: torch.Tensor | None = None
    _calls = 0

    def listen(self, hear: Callable[[], SensorNoise], env: VecEnv) -> None:
        """Take what gives the noise, once it is needed, and what scales the observations."""
        self._hear, self._scale = hear, scaling(env)

    def evaluate_actions(
        self, obs: PyTorchObs, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Return values, logarithms of the actions' probabilities, and minus the penalty."""
        assert isinstance(obs, torch.Tensor)
        values, log_prob, _ = super().evaluate_actions(obs, actions)
        self._calls += 1
        if self._calls % EVERY != 0:
            return values, log_prob, torch.zeros((), device=self.device)
        picked = torch.randint(len(obs), (PLACES,), device=self.device)
        return values, log_prob, -EVERY * self.penalty(obs[picked])

    def penalty(self, obs: torch.Tensor) -> torch.Tensor:
        """Return the penalty at observations, shape (places, size), as one number."""
        if self._noise is None:
            self._heard = self._hear()
            self._noise = torch.as_tensor(self._heard.rows, device=self.device)
            self._base = torch.as_tensor(self._heard.base, device=self.device).unsqueeze(3)
        heard, count = self._heard, len(obs)
        _, steps, episodes, _ = self._noise.shape
        mean, scale = (
            torch.as_tensor(x, dtype=obs.dtype, device=self.device).expand(obs.shape[1])
            for x in self._scale()
        )
        joint = self._joint_of(obs, mean, scale)
        first = torch.randint(steps - LENGTH + 1, (count,), device=self.device)
        which = torch.randint(episodes, (count,), device=self.device)
        times = first + torch.arange(LENGTH, device=self.device).unsqueeze(1)
        shaken = obs + scale * self._noise[joint, times, which]
        commands = torch.as_tensor(heard.commands, device=self.device)
        action, loud = (
            torch.as_tensor(x, dtype=obs.dtype, device=self.device)[joint].unsqueeze(1)
            for x in (heard.action / heard.amplitude, heard.action / heard.torque)
        )
        factors = action * scale[commands]
        past = torch.zeros(count, len(commands), device=self.device)
        still, total = self._mean(obs), torch.zeros((), device=self.device)
        for t in range(LENGTH):
            shaking = self._mean(shaken[t].index_add(1, commands, factors * past)) - still
            past = torch.cat([shaking, past[:, :-1]], dim=1)
            if t >= LENGTH // 2:
                answer = shaking + self._base[joint, times[t], which]
                total = total + (loud * answer).square().mean()
        return total / (LENGTH - LENGTH // 2)

    def _joint_of(self, obs: torch.Tensor, mean: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """Return to which joint of the noise each observation belongs, by its last numbers."""
        numbers = torch.as_tensor(self._heard.numbers, device=self.device)
        if len(numbers) == 1:
            return torch.zeros(len(obs), dtype=torch.int64, device=self.device)
        count = numbers.shape[1]
        here = (numbers - mean[-count:]) * scale[-count:]
        return torch.cdist(obs[:, -count:], here).argmin(dim=1)

    def _mean(self, obs: torch.Tensor) -> torch.Tensor:
        return torch.as_tensor(self.action_net(self.mlp_extractor.forward_actor(obs)))


def scaling(env: VecEnv) -> Callable[[], tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return what gives by what an environment shifts and then multiplies its observations now."""
    if not (isinstance(env, VecNormalize) and env.norm_obs):
        return lambda: (np.zeros(1), np.ones(1))
    statistics: Any = env.obs_rms
    return lambda: (statistics.mean, 1.0 / np.sqrt(statistics.var + env.epsilon))
