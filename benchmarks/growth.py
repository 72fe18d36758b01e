"""How time and memory grow with the number of environments and of substeps."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np

from benchmarks.report import Table
from benchmarks.speed import FRICTION, ID, batch
from benchmarks.timing import best_in_turns

NUMBERS = (64, 1024, 8192, 65536)
SUBSTEPS = (10, 20, 40)
STEPS = 65536


def size_of(env: Any) -> int:
    """Return the bytes of all arrays of a batch of environments."""
    episodes = env.unwrapped.episodes
    parts = (*episodes.plant.batch.arrays, *episodes.task, *episodes.control)
    parts += (*(episodes.plant.batch.blocks or ()), *episodes.plant._draws)
    return sum(part.nbytes for part in parts if isinstance(part, np.ndarray))


def table() -> Table:
    """Measure batches of growing size, and of growing numbers of substeps."""
    works, sizes = {}, {}
    for num in NUMBERS:
        env = gym.make_vec(ID, num_envs=num, **FRICTION)
        works[f"{num}"] = batch(env, STEPS // num)
        sizes[f"{num}"] = f"{size_of(env) / num / 1024:.1f}"
    for substeps in SUBSTEPS[1:]:
        env = gym.make_vec(ID, num_envs=1024, dt_physics=1e-3 / substeps, **FRICTION)
        works[f"1024, {substeps} substeps"] = batch(env, STEPS // 1024)
    times = best_in_turns(works, rounds=3)
    unit = times["1024"]
    rows = [[name, f"{time / unit:.2f}", sizes.get(name, "")] for name, time in times.items()]
    return Table(
        "Growth",
        "CPU time per environment and control step relative to a batch of 1024 with ten substeps, "
        "and memory of all arrays per environment; full_dynamics, Coulomb friction and cogging.",
        ["environments", "time", "kB per environment"],
        rows,
    )
