"""What the environment takes of a training with Stable-Baselines3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.report import Table
from benchmarks.speed import FRICTION
from benchmarks.timing import best_in_turns

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
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT // env.num_envs, device="cpu", seed=0)

    def work() -> int:
        model.learn(ROLLOUT)
        return ROLLOUT

    return work


def table() -> Table | None:
    """Measure PPO with the joint and with nothing; None without Stable-Baselines3."""
    try:
        from cjt_gym.envs.sb3 import TorqueTrackingVecEnv
    except ImportError:
        return None
    works = {}
    for num in NUMBERS:
        env = TorqueTrackingVecEnv(num, **FRICTION)
        works[f"{num} joints"] = learning(env)
        works[f"{num} free"] = learning(free(env))
    times = best_in_turns(works, rounds=3)
    rows = [
        [f"{num}", f"{100.0 * times[f'{num} free'] / times[f'{num} joints']:.1f} %"]
        for num in NUMBERS
    ]
    return Table(
        "Training",
        f"Rate of PPO of Stable-Baselines3 (default settings, rollouts of {ROLLOUT} steps, one "
        "thread) on the batch of joints, relative to its rate on one that costs nothing; CPU time.",
        ["environments", "rate"],
        rows,
    )
