"""The cost of gains that a search looks for: its draws, its limits, its errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.analysis import LinearPlant, probe_plant
from cjt_gym.baselines.gains import Choice
from cjt_gym.baselines.shipped import designed_gains
from cjt_gym.baselines.table import CONTROLLERS, get_entry
from cjt_gym.envs.settings import stated_by_joint
from cjt_gym.errors import ConfigurationError, SimulationError, check_range
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.training.evaluation.conditions import TASKS, Asked, Conditions
from cjt_gym.training.evaluation.metrics import RESAMPLES, squared_errors
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent, joint_of, run_mixed
from cjt_gym.training.evaluation.tasks import get_task
from cjt_gym.training.tuning.limits import Assessment, Limits, assess

TUNING_SEEDS = 600_000
"""Where the draws of the search begin; training, validation and evaluation lie elsewhere."""
HELD_OUT_SEEDS = 700_000
"""Where the unseen draws begin."""
SEED_BLOCK = 1000
"""Between two searches, more than any of them draws."""
DRAWN = (*TASKS, "reversal", "load_motion")
"""Tasks of which every episode draws one."""
STEPS = 600  # of control, in an episode
HELD_OUT_FACTOR = 4
"""Unseen episodes over those of a candidate, for a comparison that is surer than the search."""
BROKEN = 10.0
"""Cost of a broken limit, above that of any loop that keeps them: the open loop costs 1."""


@dataclass(frozen=True)
class Search(Asked):
    """What is to be tuned, and how long."""

    controller: str  # what `get_entry` takes
    joint: str  # name of the joint, or path of its file
    structure: str | None = None  # its structure; None for that of the joint file
    budget: int = 200  # candidates that are tried
    seed: int = 0  # of the search and of its draws
    # episodes that a candidate runs, all side by side; four times as many unseen ones compare the
    # best with the designed gains
    episodes: int = 32
    limits: Limits = field(default_factory=Limits)  # what the loop must keep
    dt: float = 1e-3  # sample time [s]

    def conditions(self) -> Conditions:
        """Return the conditions of the search."""
        return self.conditions_on(self.joint, self.structure, dt_control=self.dt)

    def __post_init__(self) -> None:
        for key, stated in stated_by_joint(vars(self)).items():
            object.__setattr__(self, key, stated)
        if not get_entry(self.controller).searched:
            raise ConfigurationError(
                f"Controller {self.controller} has no gains to tune. Choose another: "
                f"{', '.join(name for name, row in CONTROLLERS.items() if row.searched)}."
            )
        check_range("--budget", self.budget, low=1)
        check_range("--episodes", self.episodes, low=1)
        most = (HELD_OUT_SEEDS - TUNING_SEEDS) // SEED_BLOCK - 1
        check_range("--seed", self.seed, low=0, high=most)


@dataclass(frozen=True)
class Trial:
    """One candidate."""

    gains: dict[str, float]
    cost: float  # error over that of the open loop [-]; 10 and more where a limit is broken
    violation: float  # by how much limits are broken


@dataclass(frozen=True)
class Errors:
    """Mean squared error of every episode, and the task that it drew."""

    squares: Floats  # [N^2 m^2], shape (episodes,)
    task: NDArray[np.int64]  # its index, shape (episodes,)

    def over(self, base: Errors, rows: NDArray[np.int64] | None = None) -> float:
        """Return the rms error over that of a base, geometric mean over the tasks [-]."""
        rows = np.arange(len(self.task)) if rows is None else rows
        sums = [np.bincount(self.task[rows], weights=e.squares[rows]) for e in (self, base)]
        drawn = sums[1] > 0.0
        return float(np.exp(0.5 * np.mean(np.log(sums[0][drawn] / sums[1][drawn]))))


class Problem:
    """The cost of gains, on the draws of a search."""

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
        tasks = [task for task in DRAWN if get_task(task).applies(self.joint.structure)]
        run, task = run_mixed(agent, self.conditions, self.joint, tasks, STEPS, episodes, seed)
        return Errors(squared_errors(run), task)

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
