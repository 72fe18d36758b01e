"""The same training from several seeds: side by side here, or as tasks of a Ray cluster.

Each has its run folder; a worker of the cluster that is lost is replaced.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.training.benchmark.cluster import join_ray
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.train import train

RETRIES = 3  # a machine may go; a training that takes each along must end
STRIDE = 1000
"""Between the seeds of two trainings, so that their environments share none."""


def train_seeds(config: TrainConfig, out: str | Path, seeds: int, jobs: int) -> Iterator[RunFolder]:
    """Train from several seeds, `jobs` at a time, and yield the runs, each as it ends.

    Run k is in the folder OUT_k and has k * `STRIDE` more as seed than the configuration, which may
    have up to `STRIDE` environments. What was interrupted is resumed, what is finished stays.
    """
    check_range("--jobs", jobs, low=1)
    tasks = runs_of(config, out, seeds)
    with ProcessPoolExecutor(min(jobs, seeds), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(train, *task, quiet=True) for task in tasks]
        for future in as_completed(futures):
            yield future.result()


def runs_of(config: TrainConfig, out: str | Path, seeds: int) -> list[tuple[TrainConfig, Path]]:
    """Return configuration and run folder of each training from several seeds."""
    check_range("--seeds", seeds, low=1)
    check_range("num_envs of trainings from several seeds", config.num_envs, low=1, high=STRIDE)
    path = Path(out)
    return [
        (config.with_changes(seed=config.seed + STRIDE * k), path.with_name(f"{path.name}_{k}"))
        for k in range(seeds)
    ]


def train_on_ray(
    config: TrainConfig, out: str | Path, seeds: int, *, workers: int | None = None
) -> list[RunFolder]:
    """Do what `train_seeds` does, with each training as a task of a Ray cluster.

    A task whose worker is killed starts again on another one and resumes from the last checkpoint
    in its run folder. A cluster that is already there is used, as `RAY_ADDRESS` says, else one on
    this machine. A task takes as many cores as the configuration has threads.

    Args:
        config: What to train; it may have up to `STRIDE` environments.
        out: Path of the run folders without _k; all machines of the cluster must see it, by the
            same path.
        seeds: How many.
        workers: Cores of a cluster that is started here; all of this machine if absent.

    Returns:
        The run folders. Their facts say which finished: a training that
        diverged, or that lost too many workers, has "failed" there, and the others continue.

    Raises:
        ConfigurationError: Ray is not installed, a number is out of range, or a folder holds
            something else.
    """
    runs = runs_of(config, Path(out).resolve(), seeds)  # workers are elsewhere
    if workers is not None:
        check_range("workers", workers, low=1)
    try:
        ray = join_ray(workers)
    except ModuleNotFoundError:
        raise ConfigurationError('This needs Ray: pip install "cjt-gym[ray,train]".') from None

    def run(changed: TrainConfig, path: str) -> None:
        train(changed, path, quiet=True)

    task = ray.remote(num_cpus=config.threads, max_retries=RETRIES)(run)
    jobs = [task.options(name=path.name).remote(changed, str(path)) for changed, path in runs]
    return [_outcome(ray, job, RunFolder(path)) for job, (_, path) in zip(jobs, runs, strict=True)]


def _outcome(ray: Any, job: Any, run: RunFolder) -> RunFolder:
    """Wait for a task; note in the run folder if it was lost."""
    try:
        ray.get(job)
    except ray.exceptions.WorkerCrashedError:
        run.note(status="failed", reason="its worker was lost, time and again")
    except ray.exceptions.RayTaskError as error:
        if isinstance(error.cause, ConfigurationError):
            raise error.cause from None
        if run.facts["status"] != "failed":
            raise
    return run
