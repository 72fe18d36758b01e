"""The same training from several seeds, side by side."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from cjt_gym.errors import ConfigurationError
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.train import train

STRIDE = 1000
"""Between the seeds of two trainings, so that their environments share none."""


def train_seeds(config: TrainConfig, out: str | Path, seeds: int, jobs: int) -> Iterator[RunFolder]:
    """Train from several seeds, `jobs` at a time, and yield the runs, each as it ends.

    Run k is in the folder OUT_k and has k * `STRIDE` more as seed than the configuration, which may
    have up to `STRIDE` environments. What was interrupted is resumed, what is finished stays.
    """
    if jobs < 1:
        raise ConfigurationError(f"--jobs must be >= 1, got {jobs}.")
    tasks = runs_of(config, out, seeds)
    with ProcessPoolExecutor(min(jobs, seeds), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(train, *task, quiet=True) for task in tasks]
        for future in as_completed(futures):
            yield future.result()


def runs_of(config: TrainConfig, out: str | Path, seeds: int) -> list[tuple[TrainConfig, Path]]:
    """Return configuration and run folder of each training from several seeds."""
    if seeds < 1 or config.num_envs > STRIDE:
        raise ConfigurationError(
            f"--seeds must be >= 1 and num_envs at most {STRIDE}, got {seeds} and "
            f"{config.num_envs}."
        )
    path = Path(out)
    return [
        (config.with_changes(seed=config.seed + STRIDE * k), path.with_name(f"{path.name}_{k}"))
        for k in range(seeds)
    ]
