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
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.analysis import LinearPlant, probe_plant
from cjt_gym.baselines.shipped import designed_gains
from cjt_gym.baselines.table import CONTROLLERS, get_entry
from cjt_gym.envs.core import Episodes
from cjt_gym.errors import ConfigurationError, SimulationError
from cjt_gym.joint import Joint
from cjt_gym.joint.parameters import sha256_of
from cjt_gym.training.evaluation.conditions import TASKS, Asked, Conditions
from cjt_gym.training.evaluation.metrics import squared_errors
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent, joint_of, run_episodes
from cjt_gym.training.evaluation.tasks import Setting, get_task
from cjt_gym.training.tuning.gains import Choice
from cjt_gym.training.tuning.limits import Assessment, Limits, assess

Floats = NDArray[np.float64]
TUNING_SEEDS = 600_000
"""Where the draws of the search begin; training, validation and evaluation lie elsewhere."""
HELD_OUT_SEEDS = 700_000
"""Where the unseen draws begin."""
SEED_BLOCK = 1000
"""Between two searches, more than any of them draws."""
REFERENCES, MOVED = (*TASKS, "reversal"), "load_motion"
STEPS, STILL = 600, 3
"""Control steps of an episode; episodes with a still output for one in which it is moved."""
HELD_OUT_FACTOR = 4
"""Unseen episodes over those of a candidate, for a comparison that is surer than the search."""
BROKEN = 10.0
"""Cost of a broken limit, above that of any loop that keeps them: the open loop costs 1."""
SPREAD = 0.05
"""Deviation with which CMA-ES begins, in the unit cube: near the designed gains."""
RESAMPLES = 2000
"""Of the bootstrap over episodes."""
Generation = tuple[list[dict[str, float]], Callable[[list[float]], object]]


@dataclass(frozen=True)
class Search(Asked):
    """What is to be tuned, and how long.

    Attributes:
        controller: What `get_entry` takes.
        joint: Name of the joint, or path of its file.
        structure: Its structure.
        budget: Candidates that are tried.
        seed: Of the search and of its draws.
        episodes: Episodes that a candidate runs, all side by side; four times as many unseen
            ones compare the best with the designed gains.
        limits: What the loop must keep.
        dt: Sample time [s].

    Raises:
        UnknownNameError: There is no such controller.
        ConfigurationError: It has no gains, or budget or seed is out of range.
    """

    controller: str
    joint: str
    structure: str = "output_fixed_rigid_gearbox"
    budget: int = 200
    seed: int = 0
    episodes: int = 32
    limits: Limits = Limits()  # noqa: RUF009 - frozen
    dt: float = 1e-3

    def conditions(self) -> Conditions:
        """Return the conditions of the search."""
        return self.conditions_on(self.joint, self.structure, dt_control=self.dt)

    def __post_init__(self) -> None:
        if not get_entry(self.controller).searched:
            raise ConfigurationError(
                f"Controller {self.controller} has no gains to tune. Choose another: "
                f"{', '.join(name for name, row in CONTROLLERS.items() if row.searched)}."
            )
        if (
            self.budget < 1
            or self.episodes < 1
            or not 0 <= self.seed < (HELD_OUT_SEEDS - TUNING_SEEDS) // SEED_BLOCK
        ):
            raise ConfigurationError(
                f"--budget and --episodes must be >= 1 and --seed 0 to 99, got {self.budget}, "
                f"{self.episodes} and {self.seed}."
            )


@dataclass(frozen=True)
class Trial:
    """One candidate.

    Attributes:
        gains: Its gains.
        cost: Error over that of the open loop [-]; 10 and more where a limit is broken.
        violation: By how much limits are broken.
    """

    gains: dict[str, float]
    cost: float
    violation: float


@dataclass(frozen=True)
class Outcome:
    """What a search found.

    Attributes:
        search: What was asked for.
        best: The best candidate.
        start: The designed gains, as a candidate.
        assessment: Margins and so on of the best.
        held_out: Errors over that of the open loop on unseen draws, for the best and the designed
            gains, and their ratio with its 95 % interval.
        trials: How many were tried.
    """

    search: Search
    best: Trial
    start: Trial
    assessment: Assessment
    held_out: dict[str, float]
    trials: int

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


@dataclass(frozen=True)
class Errors:
    """Mean squared error of every episode, and the task that it drew.

    Attributes:
        squares: [N^2 m^2], shape (episodes,).
        task: Index of the reference, or the number of references where the output is moved, shape
            (episodes,).
    """

    squares: Floats
    task: NDArray[np.int64]

    def over(self, base: Errors, rows: NDArray[np.int64] | None = None) -> float:
        """Return the rms error over that of a base, geometric mean over the tasks [-]."""
        rows = np.arange(len(self.task)) if rows is None else rows
        sums = [np.bincount(self.task[rows], weights=e.squares[rows]) for e in (self, base)]
        drawn = sums[1] > 0.0
        return float(np.exp(0.5 * np.mean(np.log(sums[0][drawn] / sums[1][drawn]))))


class Problem:
    """The cost of gains, on the draws of a search.

    Every episode draws one of the references of the benchmark, and in one of four the output is
    moved; so all run side by side, in as many control steps as one does.
    """

    def __init__(self, search: Search) -> None:
        """Prepare the joint, its linear model and the errors of the open loop."""
        self.search = search
        usual = search.conditions()
        self.conditions = replace(usual, torque_amplitude=usual.amplitude)
        self.joint: Joint = joint_of(self.conditions)
        self.plant: LinearPlant = probe_plant(self.joint, search.dt)
        self.first = TUNING_SEEDS + SEED_BLOCK * search.seed
        self.open_loop = self.errors(ControllerAgent("open_loop"), self.first, search.episodes)
        row = get_entry(search.controller)
        row.check_structure(self.joint)
        self.start = designed_gains(row, self.joint, search.dt)

    def errors(self, agent: Agent, seed: int, episodes: int) -> Errors:
        """Return the errors of an agent in the episodes from a seed on."""
        references = [self._setting(task).reference for task in REFERENCES]
        arguments = agent.arguments(self.conditions)
        arguments |= {"reference": references, "episode_steps": STEPS}
        if get_task(MOVED).applies(self.search.structure):
            arguments["disturbance"] = ["zero"] * STILL + [self._setting(MOVED).load]
        same = {name: value for name, value in arguments.items() if name != "base_controller"}
        drawn = Episodes(episodes, **same)
        drawn.plant.seed(seed)
        drawn.reset()
        reference, load = drawn.task.picks.T
        task = np.where(load < STILL, reference, len(references))
        return Errors(squared_errors(run_episodes(agent, arguments, episodes, seed)), task)

    def _setting(self, task: str) -> Setting:
        return get_task(task).setting(self.conditions, self.joint)

    def choice(self, gains: dict[str, float]) -> Choice:
        """Return the controller with gains."""
        return Choice(self.search.controller, self.search.controller, gains)

    def assess(self, gains: dict[str, float]) -> Assessment:
        """Return what the limits look at."""
        law = self.choice(gains).make(self.joint, self.search.dt)
        return assess(law, self.joint, self.plant, self.conditions.amplitude)

    def trial(self, gains: dict[str, float]) -> Trial:
        """Try gains; those for which the law cannot be designed break the limits."""
        try:
            violation = self.search.limits.violation(self.assess(gains))
        except ConfigurationError:
            return Trial(gains, 10.0 * BROKEN, 10.0 * BROKEN)
        if violation > 0.0:
            return Trial(gains, BROKEN + violation, violation)
        try:
            errors = self.errors(
                ControllerAgent(self.choice(gains)), self.first, self.search.episodes
            )
        except SimulationError:
            return Trial(gains, 10.0 * BROKEN, 10.0 * BROKEN)
        return Trial(gains, min(errors.over(self.open_loop), BROKEN), 0.0)

    def held_out(self, best: dict[str, float]) -> dict[str, float]:
        """Compare gains with the designed ones on draws that the search has not seen."""
        seed = HELD_OUT_SEEDS + SEED_BLOCK * self.search.seed
        count = HELD_OUT_FACTOR * self.search.episodes
        agents = [ControllerAgent(self.choice(gains)) for gains in (best, self.start)]
        base, one, other = (
            self.errors(agent, seed, count) for agent in (ControllerAgent("open_loop"), *agents)
        )
        rng = np.random.default_rng(0)
        ratios = [one.over(other, rng.integers(count, size=count)) for _ in range(RESAMPLES)]
        low, high = np.quantile(ratios, (0.025, 0.975))
        tuned, designed = one.over(base), other.over(base)
        found = {"tuned": tuned, "designed": designed, "ratio": tuned / designed}
        return found | {"low": float(low), "high": float(high)}


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

    Args:
        search: What to tune.
        trials: File that keeps every candidate, one JSON line each. A search that was stopped
            is resumed; with other settings it starts again.
        jobs: Processes side by side.
        report: Told how many candidates were tried, and the least cost.
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
    """Give the generations of CMA-ES, begun anew elsewhere where it has converged."""
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
    """Candidates that were tried, kept in a file so that a search can go on."""

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
