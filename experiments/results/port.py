"""Energy at the output: what a joint delivers to its load over closed cycles of motion.

The reference is zero and the output is moved to and fro, at one frequency after the other. A
passive port takes energy in over every cycle. Over whole cycles, with the torque tau on the output
and its angle q without drift,

    resistance = - (sum of tau dq) / (sum of dq^2 / dt)

is the damping that the mover feels; for a linear loop it is the real part of the port's impedance.
Where it is negative, the joint feeds energy into whatever touches it.
Colgate, Hogan (1988), Robust control of dynamically interacting systems, International Journal of
Control 48.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cjt_gym.envs.core import Episodes
from cjt_gym.joint import Joint
from cjt_gym.signals import Signal
from cjt_gym.training.benchmark.grid import Cell
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.evaluation.evaluate import first_seed
from cjt_gym.training.evaluation.rollout import Agent, joint_of
from cjt_gym.training.evaluation.tasks import MOTION_HIGH, RENDERED_SHARE
from cjt_gym.training.tuning.limits import port_resistance
from experiments.results.shift import conditions_of

FREQUENCIES: Final = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Of the motion [Hz]; a whole number of cycles fits into `MEASURED`."""
SETTLED: Final = 1.0
MEASURED: Final = 2.0
"""How long a motion lasts before the energy counts, and how long it counts [s]."""
EPISODES: Final = 48
"""Enough that each frequency is drawn several times."""


def motion(conditions: Conditions, joint: Joint, frequency: float) -> Signal:
    """Return the motion of the output, up to 3 Hz as fast as that of the task `load_motion`.

    Where the output is fixed it is a velocity, above 3 Hz of as much stretch of the spring as
    there; else a load torque as large as the references.
    """
    amplitude = conditions.amplitude
    if joint.structure_row.output_fixed:
        fastest = 2.0 * np.pi * amplitude / (RENDERED_SHARE * float(joint.parameters.k_b))
        amplitude = fastest * min(1.0, MOTION_HIGH / frequency)
    t = np.arange(0.0, SETTLED + MEASURED, 0.25 * conditions.dt_control)
    # A torque that begins at its peak leaves the load without drift.
    values = np.cos(2.0 * np.pi * frequency * t)
    return Signal("file", amplitude, table=np.column_stack([t, values]))


def port_energy(cell: Cell) -> dict[str, Any]:
    """Return the damping that a mover of the output feels.

    Args:
        cell: The agent, its joint and structure.

    Returns:
        "resistance": by frequency [Hz], the mean over the episodes, over `port_resistance` [-].
    """
    conditions, agent = conditions_of(cell), cell.load()
    joint = joint_of(conditions)
    found = measure(agent, conditions, first_seed("load_motion", cell.seed))
    scale = port_resistance(joint)
    return {"resistance": {f"{f:g}": r / scale for f, r in found.items()}}


def measure(
    agent: Agent, conditions: Conditions, seed: int, episodes: int = EPISODES
) -> dict[float, float]:
    """Return the resistance [N m s/rad] by frequency [Hz].

    Raises:
        SimulationError: A state ceased to be finite.
    """
    joint, dt = joint_of(conditions), conditions.dt_control
    moves = [motion(conditions, joint, f) for f in FREQUENCIES]
    steps = round((SETTLED + MEASURED) / dt)
    arguments = agent.arguments(conditions)
    arguments |= {"reference": "zero", "disturbance": moves, "episode_steps": steps}
    batch = Episodes(episodes, **arguments)
    batch.plant.seed(seed)
    batch.reset()
    agent.begin()
    arrays, task = batch.plant.batch.arrays, batch.task
    tau, angle = (np.zeros((episodes, steps)) for _ in range(2))
    for k in range(steps):
        batch.step(agent.act(task.observation.copy()))
        tau[:, k], angle[:, k] = arrays.tau, arrays.state[:, 2]
    moved = np.diff(angle[:, round(SETTLED / dt) - 1 :], axis=1)
    moved -= moved.mean(axis=1, keepdims=True)
    mean = 0.5 * (tau[:, -moved.shape[1] :] + tau[:, -moved.shape[1] - 1 : -1])
    work, squares = np.sum(mean * moved, axis=1), np.sum(moved**2, axis=1) / dt
    frequency = np.array(FREQUENCIES)[task.picks[:, 1]]
    rows = {f: frequency == f for f in FREQUENCIES if (frequency == f).any()}
    return {f: float(-work[r].sum() / squares[r].sum()) for f, r in rows.items()}
