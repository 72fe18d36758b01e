"""Conditions other than those of the benchmark: other joints, a wider box, more delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cjt_gym.training.benchmark.grid import Cell
from cjt_gym.training.evaluation.conditions import Conditions, realistic_conditions
from cjt_gym.training.evaluation.evaluate import first_seed
from cjt_gym.training.evaluation.metrics import squared_errors
from cjt_gym.training.evaluation.rollout import joint_of, run_mixed

DELAY: Final = "command_delay.delay"
STEPS: Final = 1000
SPARE: Final = 2
"""Episodes that are run for one that counts, as not every task is drawn equally often."""


def spelt_out(variation: Any) -> dict[str, Any]:
    """Return a variation of the benchmark, a pair of factors or a mapping, as a mapping."""
    if isinstance(variation, Mapping):
        return dict(variation)
    low, high = variation
    return {"low": low, "high": high, "operation": "scale"}


def widened(
    randomization: Mapping[str, Any], box: float = 1.0, delay: float = 0.0
) -> dict[str, Any]:
    """Return a randomisation with longer ranges and a later command.

    Args:
        randomization: Ranges, as `realistic_randomization` gives them.
        box: Factor on the length of each range, about its middle; none goes below zero.
        delay: What is added to the delay of the command [s].
    """
    found = {}
    for name, variation in randomization.items():
        given = spelt_out(variation)
        middle, half = (given["high"] + given["low"]) / 2.0, (given["high"] - given["low"]) / 2.0
        more = delay if name == DELAY else 0.0
        given["low"] = max(0.0, middle - box * half) + more
        given["high"] = middle + box * half + more
        found[name] = given
    return found


def conditions_of(cell: Cell, box: float = 1.0, delay: float = 0.0) -> Conditions:
    """Return what an agent faces; the controllers' designs know the nominal joint alone."""
    usual = realistic_conditions(cell.joint, cell.structure)
    return replace(
        usual,
        torque_amplitude=usual.amplitude,
        randomization=widened(usual.randomization, box, delay),
    )


def errors_under(cell: Cell, box: float = 1.0, delay: float = 0.0) -> dict[str, Any]:
    """Return an agent's squared errors by task and episode, all tasks side by side.

    Each task keeps as many episodes as were drawn of all. Every agent has the same.

    Args:
        cell: The agent, its joint and structure, its tasks and at most how many episodes of each.
        box: Factor on the length of every range of the randomisation.
        delay: Delay on top of that of the command [s].
    """
    conditions, agent = conditions_of(cell, box, delay), cell.load()
    count = SPARE * len(cell.tasks) * cell.episodes
    seed = first_seed(cell.tasks[0], cell.seed + 2)
    joint = joint_of(conditions)
    run, drawn = run_mixed(agent, conditions, joint, cell.tasks, STEPS, count, seed)
    rows = [np.flatnonzero(drawn == k) for k in range(len(cell.tasks))]
    count = min(cell.episodes, *(len(r) for r in rows))
    squares, powers = squared_errors(run), np.mean(run.reference**2, axis=1)
    kept = {task: r[:count] for task, r in zip(cell.tasks, rows, strict=True)}
    return {
        "squares": {task: squares[r].tolist() for task, r in kept.items()},
        "powers": {task: powers[r].tolist() for task, r in kept.items()},
    }
