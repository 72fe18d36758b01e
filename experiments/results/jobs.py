"""Experiments with one agent each, done once and kept, side by side."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed, parallel_config

from cjt_gym.disk import write_text
from cjt_gym.training.benchmark.grid import Cell, attempted


@dataclass(frozen=True)
class Job:
    """One experiment with one agent.

    Attributes:
        do: What is done: a function of the cell and the options, which gives plain data.
        cell: Agent, joint, structure, tasks and number of episodes.
        options: Whatever else the function takes.
    """

    do: Callable[..., dict[str, Any]]
    cell: Cell
    options: Mapping[str, Any] = field(default_factory=dict)

    def path(self, folder: Path) -> Path:
        """Return the file of its result; its name changes with all that the result depends on."""
        text = json.dumps([self.do.__name__, self.cell.key(), self.options], sort_keys=True)
        return folder / f"{hashlib.sha256(text.encode()).hexdigest()[:20]}.json"

    def run(self) -> dict[str, Any]:
        """Do it.

        Returns:
            What the function gives, with "agent", "kind" and "status": "done"; "refused" where a
            law does not hold for the joint; "failed" where the simulation left the finite numbers;
            for the last two, "why".
        """
        agent = self.cell.load()
        base = {"agent": agent.name, "kind": agent.kind, "joint": self.cell.joint}
        return base | attempted(lambda: self.do(self.cell, **self.options))


def run_jobs(jobs: Sequence[Job], folder: Path, processes: int) -> list[dict[str, Any]]:
    """Run jobs, or take what the folder keeps of them; return their results in order."""
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    with parallel_config("loky", inner_max_num_threads=1):
        return list(Parallel(n_jobs=processes)(delayed(_kept)(job, folder) for job in jobs))


def _kept(job: Job, folder: Path) -> dict[str, Any]:
    path = job.path(folder)
    if not path.is_file():
        write_text(path, json.dumps(job.run()))
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result
