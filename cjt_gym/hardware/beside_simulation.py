"""Benchmark tasks on a real joint, with its figures beside those of the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.hardware.delayed_law import law_for
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record, part_of, read_record
from cjt_gym.signals import sampled_signal
from cjt_gym.training.benchmark import make_agents
from cjt_gym.training.evaluation.conditions import (
    SWEEP,
    TASKS,
    Conditions,
    bandwidth_reference,
    task_reference,
)
from cjt_gym.training.evaluation.evaluate import character_of, row_of
from cjt_gym.training.evaluation.rollout import Agent, Traces, run_episodes

SWEEP_NAME = "sweep"
RUNS = (*TASKS, SWEEP_NAME)
"""What is run: the tasks that track a torque, and the sweep that tells the bandwidth."""
SWEEP_SHARE = 0.5
"""Share of the amplitude in the sweep, which meets the joint's resonance."""
SECONDS = 10.0
PIECE = 1.0
"""Length of the pieces that stand for episodes; the first, with the soft start, is left out [s]."""
REAL, NOMINAL = "real", "nominal"


def tasks_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the runs that are named, or all."""
    for name in names:
        check_name("task", name, RUNS)
    return tuple(names) or RUNS


def reference_of(run: str, amplitude: float, dt: float, duration: float, seed: int) -> Floats:
    """Return the reference torque at every control step of a run [N m]."""
    signal, seconds = bandwidth_reference(SWEEP_SHARE * amplitude), SWEEP
    if run != SWEEP_NAME:
        signal, seconds = task_reference(run, amplitude), duration
    drawn = signal.reset(np.random.default_rng(seed))
    return np.asarray(drawn.torque(np.arange(round(seconds / dt), dtype=np.float64) * dt))


def side_by_side(
    config: HardwareConfig,
    controller: str,
    policy: str | None,
    paths: Mapping[str, Path],
    joints: Sequence[str],
    seed: int,
) -> list[dict[str, Any]]:
    """Return benchmark rows of the real joint and of simulated ones.

    All follow the references of the records. For the real joint the measured torque counts, from
    which noise amplification cannot be determined.

    Args:
        config: Configuration of the joint.
        controller: Name of a controller; ignored if there is a policy.
        policy: Run folder of a policy, or None.
        paths: Records of `RUNS`.
        joints: Files of further joints beside the nominal one, such as the result of a diagnosis.
        seed: Seed of the simulated sensor noise.

    Raises:
        ConfigurationError: The joint torque was not measured, or joint names are not distinct.
    """
    records = {name: part_of(read_record(path), config.name) for name, path in paths.items()}
    for record in records.values():
        if "tau" not in record:
            raise ConfigurationError(
                f"{record.owner} has no measured joint torque, which the figures need. Add a "
                "sensor: a table [sensors.NAME] with its protocol."
            )
    (agent,) = make_agents([] if policy else [controller], [policy] if policy else [])
    structure, drive = config.joint.structure, config.joint.drive
    conditions = Conditions(config.joint_name, structure, drive, dt_control=config.dt)

    @cache
    def law(late: tuple[tuple[str, float], ...]) -> Controller:
        return law_for(controller, config.joint, config.dt, dict(late))

    def laws(record: Record) -> Controller:
        return law(tuple(record.provenance.get("designed_for_s", {}).items()))

    real = {n: Traces.of_record(r, r["tau_cmd"]) for n, r in records.items()}
    rows = _rows(REAL, agent, conditions, real)
    for joint in (None, *joints):
        simulated = {
            n: _simulated(agent, conditions, joint, r, None if policy else laws(r), seed)
            for n, r in records.items()
        }
        rows += _rows(joint or NOMINAL, agent, conditions, simulated)
    return rows


def _simulated(
    agent: Agent,
    conditions: Conditions,
    joint: str | None,
    record: Record,
    law: Controller | None,
    seed: int,
) -> Traces:
    """Return a run of the agent on a simulated joint with the reference of a record.

    Observations, actions and gains are scaled for the nominal joint, as on the real one.
    """
    arguments = agent.arguments(conditions) | {
        "reference": sampled_signal(
            np.arange(len(record), dtype=np.float64) * record.dt, record["tau_ref"]
        ),
        "episode_steps": len(record) - 1,
    }
    if law is not None:
        law.reset()
        arguments["base_controller"] = lambda joint, dt: law
    if joint is not None:
        arguments |= {"joint": joint, "effects": None}
    return run_episodes(agent, arguments, 1, seed, from_zero=True)


def _rows(
    where: str, agent: Agent, conditions: Conditions, runs: Mapping[str, Traces]
) -> list[dict[str, Any]]:
    character = character_of(runs)
    rows = [
        row_of(agent, conditions, task, _pieces(runs[task]), character)
        for task in TASKS
        if task in runs
    ]
    return [{"where": where, **row.to_json()} for row in rows]


def _pieces(run: Traces) -> Traces:
    """Return a long run as a batch of one-second episodes, without the first second."""
    steps = round(PIECE / run.dt)
    count = run.tau.shape[1] // steps
    if count < 2:
        raise ConfigurationError(
            f"A run of the benchmark must be >= {2.0 * PIECE:g} s long, got "
            f"{run.tau.shape[1] * run.dt:.3g} s."
        )
    names = ("reference", "tau", "tau_measured", "command", "terminated")
    arrays = {n: getattr(run, n)[0, steps : steps * count].reshape(-1, steps) for n in names}
    return Traces(dt=run.dt, **arrays)
