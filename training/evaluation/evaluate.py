"""Evaluate controllers and policies on the same held-out episodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.training.evaluation import metrics
from cjt_gym.training.evaluation.conditions import (
    BANDWIDTH_HIGH,
    BANDWIDTH_LOW,
    EVALUATION_SEEDS,
    STEP_HOLD,
    SWEEP,
    TASKS,
    Conditions,
    bandwidth_reference,
    task_reference,
    zero_reference,
)
from cjt_gym.training.evaluation.rollout import Agent, Traces, joint_of, rollout, run_task
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS, get_task

NOISE_DURATION = 1.0  # thousand samples of the noise [s]
CHARACTER_EPISODES = 8  # as a sweep takes 8 s
SEED_BLOCK = 10_000  # seeds between two tasks: the most episodes of one
BLOCKS_PER_SEED = 8  # such blocks between two seeds
FURTHER = 1 << 40  # seeds between the first so many tasks and the next


@dataclass(frozen=True)
class Row:
    """What one agent did in one task.

    Bandwidth, overshoot, settling time and noise amplification belong to the agent and are the
    same in all its rows: they come from a sweep, from the task "step" and from a run without
    reference. NaN and infinity stand for what cannot be said, and are null in JSON.
    """

    controller: str
    kind: str  # "classical", "learned" or "residual"
    joint: str
    structure: str
    task: str  # one of `BENCHMARK_TASKS`
    rmse: float  # root mean square error of the true joint torque [N m]
    nrmse: float  # the same over the root mean square of the reference [-]
    # where the response of the torque to the reference first falls 3 dB below that at 1 to 2 Hz, at
    # the torque amplitude of the comparison [Hz]; 150 where it does not
    bandwidth_hz: float
    overshoot: float  # mean overshoot over the height of the step [-]
    settling_s: float  # median time until a step stays within 10 % of its height [s]
    effort_rms: float  # root mean square of the motor torque [N m]
    # standard deviation of the command over that of the torque sensor's noise, without reference
    # [-]
    noise_amplification: float
    episodes: int  # how many
    ci95: tuple[float, float]  # 95 % interval of rmse, by bootstrap over the episodes [N m]
    terminated: float  # share of episodes that passed a safety limit

    def to_json(self) -> dict[str, object]:
        """Return the row as plain data for JSON."""
        return {name: _plain(value) for name, value in asdict(self).items()}


def _plain(value: object) -> object:
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@dataclass(frozen=True)
class Evaluation:
    """All that one agent did."""

    agent: str
    rows: tuple[Row, ...]  # one per task
    traces: dict[str, Traces]  # what happened, per task
    sweep: Traces  # what happened under the sweep of the bandwidth

    def pooled(self) -> Traces:
        """Return the episodes of all tasks as one batch."""
        batches = list(self.traces.values())
        names = ("reference", "tau", "tau_measured", "command", "terminated")
        arrays = {name: np.concatenate([getattr(b, name) for b in batches]) for name in names}
        return Traces(dt=batches[0].dt, **arrays)


def check_episodes(episodes: int, seed: int) -> None:
    """Reject a number of episodes or a seed for which there are no draws of their own."""
    check_range("episodes", episodes, low=1, high=SEED_BLOCK)
    check_range("seed", seed, low=0)


def first_seed(task: str, seed: int) -> int:
    """Return the seed of a task's first episode, in a block of held-out episodes."""
    further, block = divmod(list(BENCHMARK_TASKS).index(task), BLOCKS_PER_SEED)
    own = SEED_BLOCK * (seed * BLOCKS_PER_SEED + block)
    return EVALUATION_SEEDS + FURTHER * further + own


def evaluate(
    agent: Agent,
    conditions: Conditions,
    tasks: Sequence[str] = TASKS,
    episodes: int = 32,
    seed: int = 0,
    report: Callable[[str], None] = lambda text: None,
) -> Evaluation:
    """Run an agent through the tasks, on seeds that no training uses.

    Args:
        agent: The agent.
        conditions: What it faces.
        tasks: Which tasks, see `BENCHMARK_TASKS`.
        episodes: Episodes of each task; each draws its own joint, reference and noise.
        seed: Which held-out episodes; the same for every agent that is to be compared.
        report: Called with what is being done.

    Raises:
        ConfigurationError: episodes or seed is out of range, or a task does not exist for the
            structure or the kind of agent.
        UnknownNameError: There is no such task.
    """
    check_episodes(episodes, seed)
    first = first_seed(next(iter(BENCHMARK_TASKS)), seed)
    assert conditions.structure is not None
    for task in tasks:
        if not get_task(task).suits(conditions.structure, agent):
            raise ConfigurationError(
                f"Task {task} does not exist for {agent.name} ({agent.kind}) on structure "
                f"{conditions.structure}. Leave it out."
            )
    conditions = replace(conditions, torque_amplitude=conditions.amplitude)
    joint = joint_of(conditions)
    traces = {}
    for task in tasks:
        report(f"{agent.name}: {task}")
        setting = get_task(task).setting(conditions, joint)
        traces[task] = run_task(agent, setting, episodes, first_seed(task, seed))
    report(f"{agent.name}: bandwidth and noise")
    sweep = _run(agent, conditions, "sweep", first)
    stepped = traces["step"] if "step" in traces else _run(agent, conditions, "step", first)
    quiet = _run(agent, conditions, "zero", first)
    character = character_of({"sweep": sweep, "step": stepped, "zero": quiet})
    rows = tuple(row_of(agent, conditions, task, run, character) for task, run in traces.items())
    return Evaluation(agent.name, rows, traces, sweep)


CHARACTER: dict[str, tuple[str, Callable[[Traces], float]]] = {
    "bandwidth_hz": ("sweep", lambda run: metrics.bandwidth(run, BANDWIDTH_LOW, BANDWIDTH_HIGH)),
    "overshoot": ("step", metrics.overshoot),
    "settling_s": ("step", metrics.settling_time),
    "noise_amplification": ("zero", metrics.noise_amplification),
}
"""What experiments tell of an agent, whatever its task."""


def character_of(runs: Mapping[str, Traces]) -> dict[str, float]:
    """Return the figures that all tasks share; NaN where the experiment for one was not run."""
    return {
        name: measure(runs[of]) if of in runs else math.nan
        for name, (of, measure) in CHARACTER.items()
    }


def row_of(
    agent: Agent, conditions: Conditions, task: str, run: Traces, character: Mapping[str, float]
) -> Row:
    """Return what the episodes of a task come to, beside the figures that all tasks share."""
    assert conditions.structure is not None
    return Row(
        controller=agent.name,
        kind=agent.kind,
        joint=conditions.joint,
        structure=conditions.structure,
        task=task,
        rmse=metrics.rmse(run),
        nrmse=metrics.nrmse(run),
        effort_rms=metrics.effort_rms(run),
        episodes=len(run.tau),
        ci95=metrics.bootstrap_rmse(run),
        terminated=float(np.mean(run.terminated.any(axis=1))),
        **character,
    )


def _run(agent: Agent, conditions: Conditions, what: str, seed: int) -> Traces:
    """Run one of the experiments that tell an agent's character."""
    amplitude = conditions.amplitude
    reference, duration = {
        "sweep": (bandwidth_reference(amplitude), SWEEP),
        "step": (task_reference("step", amplitude), 2.0 * STEP_HOLD),
        "zero": (zero_reference(), NOISE_DURATION),
    }[what]
    steps = round(duration / conditions.dt_control)
    return rollout(agent, conditions, reference, steps, CHARACTER_EPISODES, seed)
