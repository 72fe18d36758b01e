"""The batch as a vectorised environment of Stable-Baselines3, without copies of environments."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from cjt_gym.envs.core import Episodes

Indices = int | Iterable[int] | None


CHOSEN = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that set the number of threads of torch."""


def use_one_thread() -> None:
    """Let torch use one thread and report it, unless the user has chosen another number.

    The networks of torque policies are small: to hand a layer to several threads takes longer than
    to compute it. It acts once per process; what is set after that, or by the environment
    variables in `CHOSEN`, stays.
    """
    if torch.get_num_threads() <= 1 or any(os.environ.get(name) for name in CHOSEN) or _seen:
        return
    _seen.append(True)
    torch.set_num_threads(1)
    sys.stderr.write(
        "cjt_gym: torch now uses one thread, which is faster for small networks. To choose another "
        "number, call torch.set_num_threads after making the environment, or set "
        "OMP_NUM_THREADS.\n"
    )


_seen: list[bool] = []


class BareVecEnv(VecEnv):
    """What batches have in common: they hold nothing to release, wrap nothing and draw nothing.

    Attributes and methods are those of the batch that a member is in; members have none of their
    own.
    """

    def batch_of(self, index: int) -> VecEnv:
        """Return the batch of a member."""
        return self

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the batch of each index."""
        return [getattr(self.batch_of(i), attr_name) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of the batches of these indices."""
        for i in self._get_indices(indices):
            setattr(self.batch_of(i), attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the batch of each index."""
        found = [self.batch_of(i) for i in self._get_indices(indices)]
        return [getattr(batch, method_name)(*args, **kwargs) for batch in found]

    def close(self) -> None:
        """Release nothing."""

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: Indices = None
    ) -> list[bool]:
        """Return False for each: members are not wrapped."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return no images: a batch is not drawn."""
        return [None for _ in range(self.num_envs)]


class TorqueTrackingVecEnv(BareVecEnv):
    """A batch of `TorqueTrackingEnv` for Stable-Baselines3, with the same arguments.

    Episodes that end are reset within the same step; their `info` holds `terminal_observation`,
    `TimeLimit.truncated`, the keys of a single environment's step, and `episode` with return `r`
    and length `l`. The `info` of the others is empty. The first one lets torch work on one thread;
    see `use_one_thread`.
    """

    def __init__(self, num_envs: int, **arguments: Any) -> None:
        """Prepare the batch; other arguments are those of `TorqueTrackingEnv`, checked as there."""
        use_one_thread()
        self.episodes = Episodes(num_envs, **arguments)
        self.render_mode = None
        self._returns = np.zeros(num_envs)
        self._squares = np.zeros(num_envs)
        self._fresh = True
        super().__init__(num_envs, self.episodes.observation_space, self.episodes.action_space)

    def __repr__(self) -> str:
        return f"<TorqueTrackingVecEnv: {self.num_envs} episodes, {self.episodes.settings.joint!r}>"

    def reset(self) -> NDArray[np.float32]:
        """Begin all episodes; `seed` beforehand fixes what they draw."""
        if self._seeds[0] is not None:
            for i, seed in enumerate(self._seeds):
                self.episodes.plant.seed_one(i, int(seed or 0))
        elif self._fresh:
            self.episodes.plant.seed(int(np.random.SeedSequence().generate_state(1)[0]))
        self._fresh = False
        self.episodes.reset()
        self._returns[:] = self._squares[:] = 0.0
        self._reset_seeds()
        self._reset_options()
        return self.episodes.task.observation.copy()

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all members by one control step."""
        self.episodes.step(self._actions)
        task = self.episodes.task
        done = task.terminated | task.truncated
        reward = task.reward.astype(np.float32)
        self._returns += task.reward
        self._squares += (task.reference - self.episodes.plant.batch.arrays.tau) ** 2
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            self._finish(np.flatnonzero(done), infos)
            self.episodes.begin(done)
        return task.observation.copy(), reward, done, infos

    def _finish(self, ended: NDArray[np.int64], infos: list[dict[str, Any]]) -> None:
        task, report = self.episodes.task, self.episodes.info()
        samples = self.episodes.plant.batch.arrays.samples
        for i in ended:
            length = int(samples[i])
            infos[i] = {name: float(values[i]) for name, values in report.items()} | {
                "terminal_observation": task.observation[i].copy(),
                "TimeLimit.truncated": bool(task.truncated[i]),
                "episode": {"r": float(self._returns[i]), "l": length, "t": 0.0},
                "rmse": float(np.sqrt(self._squares[i] / length)),
            }
        self._returns[ended] = self._squares[ended] = 0.0


class JointsVecEnv(BareVecEnv):
    """Batches of several joints as one; what they observe and how they act must be alike."""

    def __init__(self, batches: Sequence[TorqueTrackingVecEnv]) -> None:
        """Take the batches, first to last."""
        self.batches = list(batches)
        self.render_mode = None
        self._ends = np.cumsum([batch.num_envs for batch in self.batches])
        first = self.batches[0]
        super().__init__(int(self._ends[-1]), first.observation_space, first.action_space)

    def reset(self) -> NDArray[np.float32]:
        """Begin all episodes; `seed` beforehand fixes what they draw."""
        for batch, end in zip(self.batches, self._ends, strict=True):
            batch._seeds = self._seeds[end - batch.num_envs : end]
        self._reset_seeds()
        self._reset_options()
        return np.concatenate([batch.reset() for batch in self.batches])

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        for batch, part in zip(self.batches, np.split(actions, self._ends[:-1]), strict=True):
            batch.step_async(part)

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance all members by one control step."""
        observations, rewards, dones, infos = zip(
            *(batch.step_wait() for batch in self.batches), strict=True
        )
        told = [info for some in infos for info in some]
        return np.concatenate(observations), np.concatenate(rewards), np.concatenate(dones), told

    def batch_of(self, index: int) -> TorqueTrackingVecEnv:
        """Return the batch of a member."""
        return self.batches[int(np.searchsorted(self._ends, index, side="right"))]
