"""A policy for PPO that pays for what the noise of the sensors does to the command.

With m the mean action, o an observation, d[t] what the sensors' noise does to it at rest, and b[t]
what it does to the command of the base controller,

    u[t] = m(o + d[t] + h[t]) - m(o),

where h[t] are u[t-1], u[t-2], ... at the places of the past commands, which hold those of the base
already: how the command shakes while the joint, held by its friction, does not answer. The penalty
is the mean square of u + b. It is a
smoothness in space as in Mysore et al., 2021, Regularizing Action Policies for Smooth Control,
with noise that is not white and in a loop: without the loop, policies learn to ring in their past
commands. Unlike a reward for small changes of the command it leaves the answer to the reference
free, and its gradient is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import PyTorchObs
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from cjt_gym.envs.core import Episodes
from cjt_gym.envs.observe import SIGNALS_PER_SAMPLE
from cjt_gym.errors import ConfigurationError
from cjt_gym.signals import Signal
from cjt_gym.training.config import TrainConfig, environment_arguments

EPISODES, SETTLE, STEPS, SEED = 64, 50, 256, 0
PLACES, LENGTH, EVERY = 32, 32, 4
"""How many loops are followed, for how many steps, of which the second half counts, and in which
share of the minibatches; their penalties stand for those of the others."""


@dataclass(frozen=True)
class SensorNoise:
    """What the sensors' noise does to observations at rest.

    Attributes:
        rows: Deviations of observations from their mean, shape (steps, episodes, size).
        base: Those of the base controller's command that answers each, over `action`, shape
            (steps, episodes).
        torque: Standard deviation of the measured torque from the true one [N m].
        action: Motor torque of an action of 1 [N m].
        amplitude: Torque that observations are divided by [N m].
        commands: Where an observation holds the past commands, newest first, shape (history,).
    """

    rows: NDArray[np.float32]
    base: NDArray[np.float32]
    torque: float
    action: float
    amplitude: float
    commands: NDArray[np.int64]


def sensor_noise(config: TrainConfig) -> SensorNoise:
    """Return the noise on the observations of a configuration, of joints at rest.

    The base controller acts, with a reference of zero; the policy does not.

    Raises:
        ConfigurationError: The torque sensor has no noise.
    """
    arguments = environment_arguments(config.env)
    s = Episodes(1, **arguments).settings
    names = ("torque_amplitude", "velocity_scale", "action_scale", "history")
    still = Signal("file", amplitude=0.0, table=np.zeros((1, 2)))
    arguments |= {name: getattr(s, name) for name in names}
    arguments |= {"reference": still, "disturbance": None}
    episodes = Episodes(EPISODES, **(arguments | {"episode_steps": SETTLE + STEPS}))
    episodes.seed(SEED, None)
    episodes.reset()
    seen, answers, off = [], [], []
    for step in range(SETTLE + STEPS):
        before = episodes.task.observation.copy()
        episodes.step(np.zeros((EPISODES, 1)))
        if step >= SETTLE:
            seen.append(before)
            answers.append(episodes.task.command.copy())
            told = episodes.info()
            off.append(told["tau_measured"] - told["tau"])
    torque = float(np.mean(np.std(off, axis=0)))
    if torque == 0.0:
        raise ConfigurationError(
            "noise_weight of [policy] must be 0 where the torque sensor has no noise, got "
            f"{config.policy.noise_weight}. Set it to 0, or add noise to [env.effects]."
        )
    rows = np.array(seen)
    commands = np.arange(s.preview + 4, rows.shape[-1])[
        SIGNALS_PER_SAMPLE - 1 :: SIGNALS_PER_SAMPLE
    ]
    rows -= rows.mean(axis=0)
    base = np.array(answers)
    base -= base.mean(axis=0)
    base = (base / s.action_scale).astype(np.float32)
    return SensorNoise(rows, base, torque, s.action_scale, s.torque_amplitude, commands)


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
            self._base = torch.as_tensor(self._heard.base, device=self.device).unsqueeze(2)
        heard, count = self._heard, len(obs)
        steps, episodes, _ = self._noise.shape
        first = torch.randint(steps - LENGTH + 1, (count,), device=self.device)
        which = torch.randint(episodes, (count,), device=self.device)
        times = first + torch.arange(LENGTH, device=self.device).unsqueeze(1)
        scale = torch.as_tensor(self._scale(), dtype=obs.dtype, device=self.device)
        shaken = obs + scale * self._noise[times, which]
        commands = torch.as_tensor(heard.commands, device=self.device)
        factors = heard.action / heard.amplitude * scale.expand(obs.shape[1])[commands]
        past = torch.zeros(count, len(commands), device=self.device)
        mean, total = self._mean(obs), torch.zeros((), device=self.device)
        for t in range(LENGTH):
            shaking = self._mean(shaken[t].index_add(1, commands, factors * past)) - mean
            past = torch.cat([shaking, past[:, :-1]], dim=1)
            if t >= LENGTH // 2:
                total = total + (shaking + self._base[times[t], which]).square().mean()
        return total / (LENGTH - LENGTH // 2) * (heard.action / heard.torque) ** 2

    def _mean(self, obs: torch.Tensor) -> torch.Tensor:
        return torch.as_tensor(self.action_net(self.mlp_extractor.forward_actor(obs)))


def scaling(env: VecEnv) -> Callable[[], NDArray[np.float64]]:
    """Return what gives the factors by which an environment scales its observations now."""
    if not (isinstance(env, VecNormalize) and env.norm_obs):
        return lambda: np.ones(1)
    statistics: Any = env.obs_rms
    return lambda: np.asarray(1.0 / np.sqrt(statistics.var + env.epsilon))
