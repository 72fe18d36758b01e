"""The episodes of the CPU behind the interface of `DeviceEpisodes`."""

from __future__ import annotations

from typing import Any

import torch

from cjt_gym.envs.core import Episodes

Step = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]


class HostEpisodes:
    """Episodes stepped by the kernel of the CPU, whose arrays are tensors without a copy.

    Episodes that end are reset within the same step; `last` holds what they observed last.

    Attributes:
        num_envs: How many episodes.
        device: Where the tensors are.
        observation_space: Of one episode.
        action_space: Of one episode.
        observation: Shape (num_envs, size), float32; the next step changes it.
        last: Last observation before the latest begin of each episode, same shape.
        episodes: The arrays.
    """

    def __init__(self, num_envs: int, **arguments: Any) -> None:
        """Prepare the episodes; arguments are those of `TorqueTrackingEnv`, checked as there."""
        self.episodes = Episodes(num_envs, **arguments)
        task = self.episodes.task
        self.num_envs = num_envs
        self.device = torch.device("cpu")
        self.observation_space = self.episodes.observation_space
        self.action_space = self.episodes.action_space
        self.observation = torch.from_numpy(task.observation)
        self.last = torch.zeros_like(self.observation)
        self._ends = tuple(
            torch.from_numpy(x) for x in (task.reward, task.terminated, task.truncated)
        )

    def reset(self, seed: int) -> torch.Tensor:
        """Begin all episodes and return their observations; episode i draws with seed + i."""
        self.episodes.seed(seed, None)
        self.episodes.reset()
        return self.observation

    def step(self, action: torch.Tensor) -> Step:
        """Advance all episodes by one control step.

        Args:
            action: In [-1, 1], shape (num_envs, 1); values outside are clipped.

        Returns:
            Observation, reward, terminated, truncated; the next step changes them.

        Raises:
            ConfigurationError: The action has the wrong shape or is not finite.
            SimulationError: A state ceased to be finite.
        """
        self.episodes.step(action.detach().numpy())
        task = self.episodes.task
        done = task.terminated | task.truncated
        if done.any():
            self.last[torch.from_numpy(done)] = self.observation[torch.from_numpy(done)]
            self.episodes.begin(done)
        reward, terminated, truncated = self._ends
        return self.observation, reward, terminated, truncated
