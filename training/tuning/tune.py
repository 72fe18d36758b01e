"""Tuning: the same budgeted search for the gains of every controller.

CMA-ES (Hansen, 2016, arXiv 1604.00772) searches the ranges that the controller's row gives. A
candidate that breaks a limit on margins, noise or passivity costs more than any that keeps them
all, and is not simulated. The others cost their tracking error over that of the open loop on
randomised joints, geometric mean over the tasks, which are those of the benchmark on draws of their
own. The search starts from the gains that are designed on the linear model, and
what comes out is compared with them on joints, references and noise that it has not seen. Gains
that say what is asked for, as a stiffness to render, stay as they are.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines.table import get_entry
from cjt_gym.joint.files.parameters import sha256_of
from cjt_gym.training.evaluation.rollout import joint_of
from cjt_gym.training.tuning.limits import Assessment
from cjt_gym.training.tuning.problem import Problem, Search, Trial

SPREAD = 0.05
"""Deviation with which CMA-ES begins, in the unit cube: near the designed gains."""
Generation = tuple[list[dict[str, float]], Callable[[list[float]], object]]


@dataclass(frozen=True)
class Outcome:
    """What a search found."""

    search: Search  # what was asked for
    best: Trial  # the best candidate
    start: Trial  # the designed gains, as a candidate
    assessment: Assessment  # margins and so on of the best
    # errors over that of the open loop on unseen draws, for the best and the designed gains, and
    # their ratio with its 95 % interval
    held_out: dict[str, float]
    trials: int  # how many were tried

    @property
    def feasible(self) -> bool:
        """Whether the best keeps all limits."""
        return self.best.violation == 0.0

    def facts(self) -> dict[str, Any]:
        """Return what a gain file says about its gains."""
        s = self.search
        return {
            "joint": s.joint,
            "structure": s.structure,
            "drive": s.drive,
            "effects": list(joint_of(s.conditions()).effects),
            "dt": s.dt,
            "budget": s.budget,
            "seed": s.seed,
            "episodes": s.episodes,
            "trials": self.trials,
            "feasible": self.feasible,
            "cost": self.best.cost,
            "designed_cost": self.start.cost,
            "designed_feasible": self.start.violation == 0.0,
            "held_out": self.held_out,
            "limits": asdict(s.limits),
            "figures": self.assessment.to_dict(),
        }


def to_gains(controller: str, x: Sequence[float]) -> dict[str, float]:
    """Return the gains that a search may change at a point of the unit cube.

    A gain on a logarithmic scale is exponential in its coordinate; the others go with its cube
    where their range begins at zero, so that small values are searched finely, and linearly else.
    """
    gains = {}
    for gain, at in zip(get_entry(controller).searched, x, strict=False):
        if gain.log:
            value = gain.low * (gain.high / gain.low) ** at
        else:
            share = at**3 if gain.low == 0.0 else at
            value = gain.low + (gain.high - gain.low) * share
        gains[gain.name] = float(np.clip(float(f"{value:.4g}"), gain.low, gain.high))
    return gains


def to_point(controller: str, gains: dict[str, float]) -> list[float]:
    """Return the point of the unit cube of gains."""
    x = []
    for gain in get_entry(controller).searched:
        value = min(max(gains[gain.name], gain.low), gain.high)
        if gain.log:
            at = math.log(value / gain.low) / math.log(gain.high / gain.low)
        else:
            at = (value - gain.low) / (gain.high - gain.low)
            at = at ** (1.0 / 3.0) if gain.low == 0.0 else at
        x.append(at)
    return x


def tune(
    search: Search,
    trials: Path | None = None,
    jobs: int = 1,
    report: Callable[[int, float], None] = lambda done, cost: None,
) -> Outcome:
    """Search for gains.

    The file of trials keeps every candidate, one JSON line each: a search that was stopped is
    resumed; with other settings it starts again. `report` is told how many were tried, and the
    least cost.
    """
    problem = Problem(search)
    log = TrialLog(search, trials)
    start = log.get_or(problem.start, problem.trial)
    best, done = start, 1
    for candidates, tell in _generations(search, problem.start):
        wanted = candidates[: search.budget - done]
        tried = _try_all(problem, log, wanted, jobs)
        done += len(tried)
        best = min([best, *tried], key=lambda trial: trial.cost)
        report(done, best.cost)
        if done >= search.budget:
            break
        tell([trial.cost for trial in tried])
    found = problem.assess(best.gains)
    return Outcome(search, best, start, found, problem.held_out(best.gains), done)


def _generations(search: Search, start: dict[str, float]) -> Iterator[Generation]:
    """Yield the generations of CMA-ES, which restarts elsewhere once it has converged."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma
    x0 = to_point(search.controller, start)
    x0 += [0.5] * (len(x0) == 1)  # CMA-ES needs two dimensions
    rng = np.random.default_rng(search.seed)
    while True:
        options = {"bounds": [0.0, 1.0], "seed": int(rng.integers(1, 2**31)), "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(np.clip(x0, 0.02, 0.98), SPREAD, options)
        while not strategy.stop():
            points = strategy.ask()
            gains = [start | to_gains(search.controller, list(x)) for x in points]
            yield gains, partial(strategy.tell, points)
        x0 = list(rng.random(len(x0)))


def _try_all(
    problem: Problem, log: TrialLog, candidates: list[dict[str, float]], jobs: int
) -> list[Trial]:
    """Try candidates, those that the log does not know side by side."""
    unknown = [gains for gains in candidates if _name(gains) not in log.known]
    if jobs > 1 and len(unknown) > 1:
        from joblib import Parallel, delayed

        for trial in Parallel(n_jobs=jobs)(delayed(problem.trial)(g) for g in unknown):
            log.add(trial)
    return [log.get_or(gains, problem.trial) for gains in candidates]


class TrialLog:
    """Candidates that were tried, kept in a file so that a search can be resumed."""

    def __init__(self, search: Search, path: Path | None) -> None:
        """Read what the file holds for the same settings."""
        self.path = path
        self.known: dict[str, Trial] = {}
        settings = {k: v for k, v in asdict(search).items() if k != "budget"}
        self.key = sha256_of(settings)[:16]
        if path is not None and path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    entry = json.loads(line)
                    trial = Trial(entry["gains"], entry["cost"], entry["violation"])
                except (ValueError, KeyError):
                    continue  # a line that was cut off when the search was stopped
                if entry.get("search") == self.key:
                    self.known[_name(trial.gains)] = trial

    def get_or(self, gains: dict[str, float], make: Callable[[dict[str, float]], Trial]) -> Trial:
        """Return what is known of gains, else try them."""
        known = self.known.get(_name(gains))
        return self.add(make(gains)) if known is None else known

    def add(self, trial: Trial) -> Trial:
        """Keep a candidate."""
        self.known[_name(trial.gains)] = trial
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"search": self.key, **asdict(trial)}) + "\n")
        return trial


def _name(gains: dict[str, float]) -> str:
    return json.dumps(gains, sort_keys=True)
