"""Trainings on a Ray cluster."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from cjt_gym.errors import ConfigurationError
from cjt_gym.training.benchmark.cluster import join_ray
from cjt_gym.training.learning.config import TrainConfig, from_dict
from cjt_gym.training.learning.distributed import STRIDE, train_on_ray

CONFIG: dict[str, Any] = {
    "total_steps": 24_000,
    "num_envs": 8,
    "checkpoint_every": 2_000,
    "env": {"structure": "output_fixed_rigid_gearbox", "episode_steps": 50},
    "policy": {"net_arch": [8]},
    "algorithm_options": {"n_steps": 64, "batch_size": 128, "n_epochs": 2},
    "evaluation": {"every": 100_000, "episodes": 2},
}


def config() -> TrainConfig:
    return from_dict(CONFIG, "the test")


def test_no_seeds_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="--seeds must be >= 1"):
        train_on_ray(config(), tmp_path / "run", 0)


@pytest.fixture(scope="module")
def ray() -> Iterator[Any]:
    pytest.importorskip("ray")
    found = join_ray(workers=2)
    yield found
    found.shutdown()


def workers_of(word: str) -> list[int]:
    """Return the processes that work on tasks of a name."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if path.read_bytes().startswith(b"ray::" + word.encode()):
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


def first_step(log: Path) -> int:
    """Return the first step of which a TensorBoard file knows something."""
    events = EventAccumulator(str(log)).Reload()
    return min(events.Scalars(tag)[0].step for tag in events.Tags()["scalars"])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_is_replaced_and_goes_on_from_its_checkpoint(
    ray: Any, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill() -> None:
        end = time.monotonic() + 300.0
        while time.monotonic() < end and not killed:
            if list((tmp_path / "run_1" / "checkpoints").glob("step_*")):
                for process in workers_of("run_1"):
                    os.kill(process, signal.SIGKILL)
                    killed.append(process)
            time.sleep(0.1)

    killer = threading.Thread(target=kill)
    killer.start()
    runs = train_on_ray(config(), tmp_path / "run", 2)
    killer.join()
    assert len(killed) == 1
    facts = [run.facts for run in runs]
    assert [(f["seed"], f["status"]) for f in facts] == [
        (0, "finished"),
        (STRIDE, "finished"),
    ]
    assert facts[0]["begun_times"] == 1
    assert facts[1]["begun_times"] == 2
    assert all(f["steps"] >= CONFIG["total_steps"] for f in facts)
    # It has not begun anew: the second log begins behind a checkpoint.
    first, second = sorted((runs[1].path / "tensorboard").glob("events*"))
    assert first_step(first) < CONFIG["checkpoint_every"] < first_step(second)


def sb3_on_registered(seed: int) -> int:
    """Train on a registered environment, as any user of Stable-Baselines3 would."""
    import stable_baselines3 as sb3
    from stable_baselines3.common.env_util import make_vec_env

    import cjt_gym  # noqa: F401 - registers the environments

    envs = make_vec_env("CJT/OutputFixedRigidGearbox-v0", n_envs=2, seed=seed)
    model = sb3.PPO("MlpPolicy", envs, n_steps=64, batch_size=64, seed=seed)
    return int(model.learn(256).num_timesteps)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_registered_environments_work_in_tasks_as_they_are(ray: Any) -> None:
    task = ray.remote(num_cpus=1)(sb3_on_registered)
    assert ray.get([task.remote(seed) for seed in (0, 1)]) == [256, 256]
