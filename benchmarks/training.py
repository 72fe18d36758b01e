"""What the environment takes of a training with Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from benchmarks.report import Table
from benchmarks.speed import FRICTION, sb3_batch
from benchmarks.timing import best_in_turns
from cjt_gym.envs.sb3 import TorqueTrackingVecEnv

NUMBERS = (8, 64, 256)
ROLLOUT = 2048


def free(env: Any) -> Any:
    """Return a batch with the spaces of another that always answers the same."""

    class Free(type(env)):  # type: ignore[misc]
        def step_wait(self) -> Any:
            num = self.num_envs
            infos: list[dict[str, Any]] = [{} for _ in range(num)]
            zeros = np.zeros(num, np.float32)
            return self.episodes.task.observation, zeros, np.zeros(num, np.bool_), infos

    return Free(env.num_envs, **FRICTION)


def learning(env: Any) -> Callable[[], int]:
    """Return work that trains on one rollout; its unit is a step of a member."""
    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT // env.num_envs, device="cpu", seed=0)

    def work() -> int:
        model.learn(ROLLOUT)
        return ROLLOUT

    return work


def table() -> Table:
    """Measure PPO with the joint and with nothing."""
    works = {}
    for num in NUMBERS:
        env = TorqueTrackingVecEnv(num, **FRICTION)
        works[f"{num} joints"] = sb3_batch(num, FRICTION, 100 + 2 * ROLLOUT // num)
        works[f"{num} free"] = learning(free(env))
    times = best_in_turns(works, rounds=3)
    rows = []
    for num in NUMBERS:
        alone, joints = times[f"{num} free"], times[f"{num} joints"]
        rate = 100.0 * alone / (alone + joints)
        rows.append([f"{num}", f"{1e6 * alone:.0f}", f"{1e6 * joints:.1f}", f"{rate:.1f} %"])
    return Table(
        "Training",
        f"Rate of PPO of Stable-Baselines3 (default settings, rollouts of {ROLLOUT} steps, one "
        "thread) on the batch of joints, relative to its rate on one that costs nothing: "
        "CPU time of a step of training on one that costs nothing, of a step of a joint (full "
        "dynamics, friction, cogging), and the first's share of the sum.",
        ["environments", "training [us]", "joint [us]", "rate"],
        rows,
    )
