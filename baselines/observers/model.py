"""The joint that observers and state feedback are designed on: mechanics and a disturbance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.linear_law import COMMAND, MEASURED, SIGNALS, signals
from cjt_gym.baselines.mechanics import Mechanics, with_commands
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.pbh import check_observable
from cjt_gym.baselines.plant_model import SampledJoint, scatter
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import Joint


@dataclass(frozen=True)
class DesignModel:
    """A sampled joint x[k+1] = a x[k] + b u[k - delay], y = c x.

    With a fixed output, angles and velocities count from those of the load, so that the load's own
    are zero. With a free load, the position of the last body is a state where an angle is measured.
    With a disturbance, the last state is a constant torque that acts on the motor as u does.
    """

    a: Floats  # shape (order, order)
    b: Floats  # shape (order,)
    c: Floats  # measured outputs, shape (outputs, order)
    tau: Floats  # joint torque, shape (order,)
    rows: Floats  # how `SIGNALS` give the outputs, shape (outputs, 9)
    noise: Floats  # standard deviations of the outputs' noise, shape (outputs,); see `output_noise`
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    delay: int  # between command and measurement [samples]
    dt: float  # sample time [s]


def design_model(
    model: SampledJoint, outputs: tuple[str, ...] = ("tau",), disturbance: bool = True
) -> DesignModel:
    """Return the model of a joint."""
    _check_outputs(outputs)
    plant, joint = mechanics_for(model, outputs), model.joint
    fixed, states = plant.fixed, _state_names(joint, len(plant.b))
    c, tau = np.array([plant.row(name) for name in outputs]), plant.row("tau")
    a, b = plant.a, plant.b
    a_c, b_c = plant.continuous
    if disturbance:
        a = _with_disturbance(a, b, 1.0)
        a_c = _with_disturbance(a_c, b_c, 0.0)
        b, tau = np.append(b, 0.0), np.append(tau, 0.0)
        c = np.concatenate([c, np.zeros((len(c), 1))], axis=1)
        states += ("disturbance",)
    what = model.name + (" with a disturbance" if disturbance else "")
    check_observable(a_c, c, outputs, what, states)
    rows = np.array([output_row(name, fixed) for name in outputs])
    noise = np.array([output_noise(model, name) for name in outputs])
    return DesignModel(a, b, c, tau, rows, noise, outputs, states, model.loop.delay, model.dt)


def mechanics_for(model: SampledJoint, outputs: tuple[str, ...]) -> Mechanics:
    """Return the mechanics with all states that the outputs may show."""
    free = not model.mechanics.fixed
    return model.placed if free and any(n.startswith("q_") for n in outputs) else model.mechanics


def _check_outputs(outputs: tuple[str, ...]) -> None:
    for name in outputs:
        check_name("output of an observer", name, MEASURED)
    if not outputs or len(set(outputs)) < len(outputs):
        raise ConfigurationError(
            f"outputs of an observer must be different ones of {', '.join(MEASURED)}, got "
            f"{outputs}."
        )


def _with_disturbance(a: Floats, b: Floats, pole: float) -> Floats:
    wide = np.asarray(block_diag(a, [[pole]]))
    wide[:-1, -1] = b
    return wide


def _state_names(joint: Joint, order: int) -> tuple[str, ...]:
    row = joint.structure_row
    bodies = ["mgl"[row.groups.index(g)] for g in range(row.size)]
    ends = ["l"] * row.size if row.output_fixed else bodies[1:]
    bends = [f"q_{one}{two}" for one, two in zip(bodies, ends, strict=False)]
    names = (*bends, *(f"dq_{body}" for body in bodies))
    return names if len(names) == order else (*names, f"q_{bodies[-1]}")


def output_row(name: str, fixed: bool) -> Floats:
    """Return how `SIGNALS` give an output, shape (9,)."""
    kind, _, _ = name.rpartition("_")
    row = signals(**{name: 1.0})
    return row - signals(**{f"{kind}_l": 1.0}) if fixed and kind else row


def output_noise(model: SampledJoint, name: str) -> float:
    """Return the standard deviation of an output's noise, in the unit of the output.

    That of a velocity is what `velocity_differentiation` makes of its angle's, or a difference
    over a sample where that effect is off. With a fixed output, the load's noise adds to it.
    """
    kind, _, body = name.rpartition("_")
    known = dict(zip(("tau", "q_m", "q_g", "q_l"), scatter(model.joint), strict=True))
    if not kind:
        return float(known[name])
    angle = math.hypot(known[f"q_{body}"], known["q_l"] if model.mechanics.fixed else 0.0)
    if kind == "q":
        return angle
    cutoff = model.joint.setting("velocity_differentiation", "cutoff")
    keep = math.exp(-2.0 * math.pi * cutoff * model.dt) if cutoff > 0.0 else 0.0
    return angle * (1.0 - keep) / model.dt * math.sqrt(2.0 / (1.0 + keep))


def current_observer(model: DesignModel, gain: Floats) -> LinearObserver:
    """Return the observer that corrects its prediction with the present measurement.

        x^[k] = x-[k] + m (y[k] - c x-[k]),   x-[k+1] = a x^[k] + b u[k - delay]

    Args:
        model: The joint.
        gain: m, shape (order, outputs).

    Returns:
        An observer of the states and, beside them, "tau"; then of "innovation_..." by output.
    """
    n, late = len(model.b), model.delay
    keep = np.eye(n) - gain @ model.c
    into, direct = model.a @ gain @ model.rows, gain @ model.rows
    a, head = with_commands(model.a @ keep, model.b, late)
    b = np.zeros((n + late, len(SIGNALS)))
    b[:n] = into
    b[:, COMMAND] += head
    c, d = [keep, model.tau[None] @ keep, -model.c], [direct, model.tau[None] @ direct, model.rows]
    wide = np.zeros((n + 1 + len(model.c), n + late))
    wide[:, :n] = np.concatenate(c)
    names = (*model.states, "tau", *(f"innovation_{name}" for name in model.outputs))
    return LinearObserver(a, b, wide, np.concatenate(d), names, model.dt)
