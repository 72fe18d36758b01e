"""Feedback of states behind a delay, and the reference that goes with it.

The joint that a law sees is x[k+1] = a x[k] + b u[k - delay]: the commands on their way are known,
so they are states too, and feedback of all of them is that of the state as it will be.

References:
    Astrom, Wittenmark (1997), Computer-Controlled Systems, sections 3.5 and 4.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solve_discrete_are

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.linear_law import Block, signals, static, through
from cjt_gym.baselines.mechanics import with_commands
from cjt_gym.baselines.pbh import check_stabilisable
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError


@dataclass(frozen=True)
class Feedback:
    """u = reference_gain r - states x - commands u_before - integral z."""

    states: Floats  # gains of the joint's states, shape (order,)
    commands: Floats  # gains of the commands on their way, the oldest last, shape (delay,)
    integral: float  # gain of the integral of the torque error, tau - r, times dt
    reference_gain: float  # gain of the reference


def check_torque_controllable(model: SampledJoint) -> None:
    """Raise ConfigurationError unless the motor moves all modes and the torque can be held."""
    a, b = model.mechanics.continuous
    check_stabilisable(a, b[:, None], model.name)
    zeros = model.torque.zeros
    if len(zeros) and np.min(np.abs(zeros)) < 1e-9 * np.max(np.abs(model.torque.poles)):
        raise ConfigurationError(
            f"No command holds a joint torque of {model.name}: from motor torque to joint torque "
            "it has a zero at zero frequency. Choose a structure whose output is fixed."
        )


@lru_cache(maxsize=128)
def quadratic_feedback(model: SampledJoint, effort: float, reset: float) -> Feedback:
    """Return the feedback with the least sum of (tau - r)^2 + reset^2 z^2 + effort (u - r)^2.

    z is the integral of the torque error; `effort` > 0, and `reset` [1/s] is 0 for none.
    """
    check_torque_controllable(model)
    plant, delay = model.mechanics, model.loop.delay
    n = len(plant.b)
    c = plant.row("tau")
    a, b = with_commands(plant.a, plant.b, delay)
    if reset > 0.0:
        wide = np.zeros((len(b) + 1,) * 2)
        wide[:-1, :-1], wide[-1, :n], wide[-1, -1] = a, model.dt * c, 1.0
        a, b = wide, np.append(b, 0.0)
    q = np.zeros_like(a)
    q[:n, :n] = np.outer(c, c)
    if reset > 0.0:
        q[-1, -1] = reset**2
    p = solve_discrete_are(a, b[:, None], q, np.array([[effort]]))
    k = (b @ p @ a) / (effort + b @ p @ b)
    return with_reference(model, k[:n], k[n : n + delay], float(k[-1]) if reset > 0.0 else 0.0)


def placed_feedback(model: SampledJoint, poles: Sequence[complex]) -> Feedback:
    """Return the feedback with closed-loop poles in the s plane [rad/s], one per state.

    The poles that the delay adds stay at z = 0.
    """
    from scipy.signal import place_poles  # takes long to import

    check_torque_controllable(model)
    plant, delay = model.mechanics, model.loop.delay
    wanted = np.exp(np.asarray(poles, dtype=np.complex128) * model.dt)
    k = place_poles(plant.a, plant.b[:, None], wanted).gain_matrix[0]
    powers = [np.linalg.matrix_power(plant.a, i) for i in range(delay + 1)]
    commands = np.array([k @ powers[i] @ plant.b for i in range(delay)])
    return with_reference(model, k @ powers[delay], commands, 0.0)


def with_reference(
    model: SampledJoint, states: Floats, commands: Floats, integral: float
) -> Feedback:
    """Return the feedback with the reference's gain that gives the torque unit gain at rest."""
    plant = model.mechanics
    rest = np.linalg.solve(np.eye(len(plant.b)) - plant.a, plant.b)
    hold = 1.0 / float(plant.row("tau") @ rest)
    gain = hold * (1.0 + float(states @ rest) + float(np.sum(commands)))
    return Feedback(states, commands, integral, gain)


def measured_states(model: SampledJoint) -> Floats:
    """Return the rows that give the states of a joint with fixed output, shape (order, 9)."""
    bodies = "mg"[: model.joint.structure_row.size]
    return np.array(
        [signals(**{f"q_{body}": 1.0, "q_l": -1.0}) for body in bodies]
        + [signals(**{f"dq_{body}": 1.0, "dq_l": -1.0}) for body in bodies]
    )


def reference_and_commands(feedback: Feedback) -> list[Block]:
    """Return the blocks of reference and of commands on their way."""
    delay = len(feedback.commands)
    late = np.eye(delay, k=-1), np.eye(1, delay)[0], -feedback.commands, 0.0
    return [static(reference=feedback.reference_gain), through(late, command=1.0)]
