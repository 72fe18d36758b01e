"""PPO on tensors with skrl, a batch learner: episodes on the CPU or on a CUDA device."""

from __future__ import annotations

from typing import Any

import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import Wrapper
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from torch import nn

from cjt_gym.training.gpu import HostEpisodes

Transition = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict[str, Any]]


class SkrlEpisodes(Wrapper):  # type: ignore[misc]
    """Episodes as an environment of skrl; observations never leave their device.

    Episodes that end are reset within the same step. Learners that bootstrap need
    `time_limit_bootstrap=True`, because episodes end by their length.
    """

    def __init__(self, episodes: Any, seed: int = 0) -> None:
        """Wrap episodes.

        Args:
            episodes: `HostEpisodes` or `DeviceEpisodes`.
            seed: Episode i draws with seed + i.
        """
        super().__init__(episodes)
        self.episodes, self._seed = episodes, seed

    def reset(self) -> tuple[torch.Tensor, dict[str, Any]]:
        """Begin all episodes."""
        return self.episodes.reset(self._seed).clone(), {}

    def step(self, actions: torch.Tensor) -> Transition:
        """Advance all episodes; what is handed back is a copy on the same device."""
        observation, reward, terminated, truncated = self.episodes.step(actions)
        ends = terminated.clone().unsqueeze(1), truncated.clone().unsqueeze(1)
        return observation.clone(), reward.float().unsqueeze(1), *ends, {}

    def state(self) -> None:
        """Return nothing: the critic sees what the actor sees."""

    def render(self, *args: Any, **kwargs: Any) -> None:
        """Draw nothing."""

    def close(self) -> None:
        """Release nothing."""


class Actor(GaussianMixin, Model):  # type: ignore[misc]
    """A Gaussian policy with two hidden layers of 64."""

    def __init__(self, env: SkrlEpisodes) -> None:
        spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
        Model.__init__(self, **spaces, device=env.device)
        GaussianMixin.__init__(self)
        self.net = network(self.num_observations, 1)
        with torch.no_grad():
            list(self.net.parameters())[-2].mul_(0.01)  # begin close to the base controller
        self.log_std = nn.Parameter(torch.full((1,), -1.5))  # likewise

    def compute(self, inputs: dict[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Return the mean action."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Critic(DeterministicMixin, Model):  # type: ignore[misc]
    """The value of an observation, with two hidden layers of 64."""

    def __init__(self, env: SkrlEpisodes) -> None:
        spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
        Model.__init__(self, **spaces, device=env.device)
        DeterministicMixin.__init__(self)
        self.net = network(self.num_observations, 1)

    def compute(self, inputs: dict[str, Any], role: str) -> tuple[torch.Tensor, dict[str, Any]]:
        """Return the value."""
        return self.net(inputs["observations"]), {}


def network(size: int, out: int) -> nn.Sequential:
    """Return two hidden layers of 64 with tanh."""
    hidden = [nn.Linear(size, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()]
    return nn.Sequential(*hidden, nn.Linear(64, out))


def learn(episodes: Any, steps: int, *, seed: int = 0, **options: Any) -> Actor:
    """Train a policy with skrl's PPO and return it.

    Args:
        episodes: `HostEpisodes` or `DeviceEpisodes`.
        steps: Control steps of each episode's slot; in all, num_envs times as many.
        seed: Of networks and episodes.
        **options: Of `PPO_CFG`, instead of those below.
    """
    torch.manual_seed(seed)
    env = SkrlEpisodes(episodes, seed)
    actor = Actor(env)
    settings: dict[str, Any] = {
        "rollouts": 32,
        "learning_epochs": 5,
        "mini_batches": 4,
        "learning_rate": 1e-3,
        "time_limit_bootstrap": True,
        "discount_factor": 0.95,
        "experiment": {"write_interval": 0, "checkpoint_interval": 0},
        **options,
    }
    agent = PPO(
        models={"policy": actor, "value": Critic(env)},
        memory=RandomMemory(
            memory_size=settings["rollouts"], num_envs=env.num_envs, device=env.device
        ),
        cfg=PPO_CFG(**settings),
        observation_space=env.observation_space,
        action_space=env.action_space,
        device=env.device,
    )
    trainer: dict[str, Any] = {"timesteps": steps, "headless": True, "disable_progressbar": True}
    trainer["close_environment_at_exit"] = False
    SequentialTrainer(cfg=trainer, env=env, agents=agent).train()
    return actor


@torch.no_grad()
def mean_reward(actor: Actor | None, episodes: HostEpisodes, steps: int, seed: int) -> float:
    """Return the mean reward per control step of a policy without noise, or of no action.

    Args:
        actor: The policy, or None.
        episodes: Where it acts.
        steps: How long.
        seed: Episode i draws with seed + i.
    """
    observation = episodes.reset(seed)
    total = torch.zeros((), dtype=torch.float64, device=episodes.device)
    for _ in range(steps):
        action = actor.net(observation) if actor is not None else None
        still = torch.zeros(episodes.num_envs, 1, device=episodes.device)
        observation, reward, _, _ = episodes.step(still if action is None else action)
        total += reward.mean()
    return float(total) / steps
