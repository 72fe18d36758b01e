"""The performance gap: what a controller or a policy earns in simulation, and what on the joint.

A policy is trained in a simulated world and used in the recorded one. Run in the nominal and in the
identified joint against the recorded reference, it shows how much of the difference a diagnosis
explains.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cjt_gym.envs.settings import REWARD_WEIGHTS
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant.simulated import DT_PHYSICS
from cjt_gym.records import Record
from cjt_gym.signals import Signal
from cjt_gym.training.evaluation import metrics
from cjt_gym.training.evaluation.conditions import EVALUATION_SEEDS, Conditions
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent, Traces, run_episodes

EPISODES = 8  # in each joint, which differ by start and noise alone
BLOCK = 0.5
"""Length of a block of the bootstrap [s]."""
DRAWS = 400  # of the bootstrap, for two digits of an interval


@dataclass(frozen=True)
class Performance:
    """What an agent does in one world, by the torque that is measured there."""

    # mean reward per control step: tracking and smoothness, as the environment weighs them
    reward: float
    rmse: float  # root mean square error of the measured joint torque [N m]
    nrmse: float  # the same over the root mean square of the reference
    low: float  # low end of the 95 % interval of rmse, by bootstrap over blocks [N m]
    high: float  # high end [N m]
    terminated: float = 0.0  # share of episodes that passed a safety limit


@dataclass(frozen=True)
class PerformanceGap:
    """What an agent does in the nominal, the identified and the recorded world."""

    agent: str
    nominal: Performance  # in the joint before the diagnosis
    identified: Performance  # in the joint with its effects
    recorded: Performance | None  # in the record, where that was made with the agent
    # share of the difference of rmse between the nominal and the recorded world that the identified
    # one takes away; None without a recorded world
    removed: float | None
    note: str  # what to know about the comparison


def performance_gap(
    record: Record,
    nominal: Joint,
    identified: Joint,
    agent: Agent,
    episodes: int = EPISODES,
) -> PerformanceGap:
    """Run an agent in both joints against the reference of a record, and compare.

    The gains of a classical controller are those for the nominal joint in both worlds, as its user
    would have set them. Episodes differ by where the joint stands and by the sensors' noise.

    Args:
        record: Has `tau_ref` [N m], and, for the recorded world, `tau` and `tau_cmd` or `i_cmd`.
        nominal: The joint before the diagnosis.
        identified: The joint with its effects.
        agent: A controller or a policy; see `make_agents`.
        episodes: How many in each joint.

    Raises:
        ConfigurationError: The record has no usable reference, or the policy another control step.
        SimulationError: A state ceased to be finite.
    """
    reference = _reference(record)
    amplitude = float(np.abs(reference).max())
    worlds, scale = [], amplitude
    for joint in (nominal, identified):
        arguments = _arguments(agent, joint, nominal, record, amplitude)
        scale = float(arguments["torque_amplitude"])
        traces = run_episodes(agent, arguments, episodes, EVALUATION_SEEDS)
        worlds.append(_performance(traces, scale))
    recorded, note = _recorded(record, nominal, agent, scale)
    removed = None
    if recorded is not None:
        before, after = (abs(w.rmse - recorded.rmse) for w in worlds)
        removed = 1.0 - after / before if before > 0.0 else 0.0
    return PerformanceGap(agent.name, worlds[0], worlds[1], recorded, removed, note)


def _reference(record: Record) -> Floats:
    if "tau_ref" not in record:
        raise ConfigurationError(
            f"{record.owner} must have the column tau_ref [N m] to compare performances. Record "
            "the reference of the torque too."
        )
    reference = record["tau_ref"]
    if not np.isfinite(reference).all() or not np.any(reference):
        raise ConfigurationError(
            f"tau_ref of {record.owner} must be finite and not zero throughout to compare "
            "performances. Take another part of the record."
        )
    return reference


def _arguments(
    agent: Agent, joint: Joint, nominal: Joint, record: Record, amplitude: float
) -> dict[str, Any]:
    """Return the environment's arguments for one world."""
    times = np.arange(len(record)) * record.dt
    home = agent.trained_on
    conditions = Conditions(
        home[0] if home else joint.file.name,
        home[1] if home else joint.structure,
        joint.drive,
        torque_amplitude=amplitude,
        dt_control=record.dt,
        dt_physics=record.dt / max(np.ceil(record.dt / DT_PHYSICS), 1.0),
    )
    arguments = agent.arguments(conditions)
    given: Callable[[Joint, float], Any] | None = arguments.get("base_controller")
    if given is not None:
        arguments["base_controller"] = lambda _joint, dt: given(nominal, dt)
    return arguments | {
        "joint": joint,
        "structure": joint.structure,
        "drive": joint.drive,
        "effects": None,
        "randomization": None,
        "reference": Signal("file", table=np.column_stack([times, record["tau_ref"]])),
        "episode_steps": len(record) - 1,
    }


def _code(agent: Agent) -> str | None:
    """Return PATH.py:NAME of your own code unchanged, as records name it."""
    if isinstance(agent, ControllerAgent) and not agent.choice.gains:
        return agent.choice.controller
    return None


def _recorded(
    record: Record, nominal: Joint, agent: Agent, amplitude: float
) -> tuple[Performance | None, str]:
    """Return the performance in the record and what to know about it."""
    made_by = record.provenance.get("controller") or record.provenance.get("policy")
    if made_by is not None and made_by not in (agent.name, _code(agent)):
        return None, f"The record was made with {made_by}: it does not show {agent.name}."
    command = _command(record, nominal)
    if "tau" not in record or command is None or not np.isfinite(record["tau"]).all():
        return None, "The record lacks the joint torque tau or the command, or parts of them."
    note = "" if made_by else "The record does not say with what it was made; taken for the same."
    return _performance(Traces.of_record(record, command), amplitude), note


def _command(record: Record, nominal: Joint) -> Floats | None:
    if "tau_cmd" in record:
        return record["tau_cmd"]
    if "i_cmd" in record:
        return record["i_cmd"] * nominal.parameters.k_t * nominal.parameters.n
    return None


def _performance(traces: Traces, amplitude: float) -> Performance:
    measured = replace(traces, tau=traces.tau_measured)
    low, high = _interval(measured)
    return Performance(
        float(np.mean(rewards(measured, amplitude))),
        metrics.rmse(measured),
        metrics.nrmse(measured),
        low,
        high,
        float(np.mean(traces.terminated.any(axis=1))),
    )


def rewards(traces: Traces, amplitude: float) -> Floats:
    """Return the reward of every step, as the environment computes it, shape (episodes, steps).

    It is scaled by the torque `amplitude` [N m]. The terms of safety are left out: a record does
    not end.
    """
    u, weights = traces.command / amplitude, REWARD_WEIGHTS
    before = np.concatenate([np.zeros((len(u), 1)), u[:, :-1]], axis=1)
    total: Floats = -weights["tracking"] * np.abs(traces.error / amplitude)
    total -= weights["smoothness"] * (u - before) ** 2 + weights["effort"] * u**2
    return total


def _interval(traces: Traces) -> tuple[float, float]:
    """Return the 95 % interval of the rmse, by a bootstrap over blocks of all episodes."""
    size = max(int(BLOCK / traces.dt), 1)
    count = max(traces.error.shape[1] // size, 1)
    blocks = np.array_split(traces.error**2, count, axis=1)
    means = np.concatenate([block.mean(axis=1) for block in blocks])
    rng = np.random.default_rng(0)
    drawn = np.sqrt(means[rng.integers(0, len(means), (DRAWS, len(means)))].mean(axis=1))
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)
