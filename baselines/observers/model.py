"""The joint that observers and state feedback are designed on: mechanics and a disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from cjt_gym.baselines.linear_law import COMMAND, SIGNALS, signals
from cjt_gym.baselines.observers.linear_observer import LinearObserver
from cjt_gym.baselines.pbh import check_observable
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.joint import Joint

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DesignModel:
    """A sampled joint x[k+1] = a x[k] + b u[k - delay], y = c x, all relative to the load.

    With a fixed output, angles and velocities count from those of the load. With a disturbance,
    the last state is a constant torque that acts on the motor as u does.

    Attributes:
        a: Shape (order, order).
        b: Shape (order,).
        c: Measured outputs, shape (outputs, order).
        tau: Joint torque, shape (order,).
        rows: How `SIGNALS` give the outputs, shape (outputs, 9).
        outputs: Their names.
        states: Names of the states.
        delay: Between command and measurement [samples].
        dt: Sample time [s].
    """

    a: Floats
    b: Floats
    c: Floats
    tau: Floats
    rows: Floats
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    delay: int
    dt: float


def design_model(
    model: SampledJoint, outputs: tuple[str, ...] = ("tau",), disturbance: bool = True
) -> DesignModel:
    """Return the model of a joint with a torsion bar.

    Args:
        model: The joint; its delays are rounded up to samples.
        outputs: Measured signals: "tau", "q_m", "q_g", "dq_m", "dq_g"; with a free load "dq_l".
        disturbance: Whether a constant motor torque is among the states.

    Raises:
        UnknownNameError: An output is not one of these.
        ConfigurationError: The outputs do not show all states; see `check_observable`.
    """
    plant, joint = model.mechanics, model.joint
    fixed = joint.structure_row.output_fixed
    known = ("tau", "q_m", "q_g", "dq_m", "dq_g") + (() if fixed else ("dq_l",))
    for name in outputs:
        if name not in known:
            raise unknown_name("output of an observer", name, known)
    states = _state_names(joint)
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
    check_observable(a_c, c, outputs, what)
    rows = np.array([_row(name, fixed) for name in outputs])
    return DesignModel(a, b, c, tau, rows, outputs, states, model.loop.delay, model.dt)


def _with_disturbance(a: Floats, b: Floats, pole: float) -> Floats:
    wide = np.asarray(block_diag(a, [[pole]]))
    wide[:-1, -1] = b
    return wide


def _state_names(joint: Joint) -> tuple[str, ...]:
    groups = joint.structure_row.groups
    first = {g: body for body, g in reversed(list(zip("mgl", groups, strict=True))) if g >= 0}
    bodies = [first[g] for g in range(joint.structure_row.size)]
    ends = [*bodies[1:], "l"] if joint.structure_row.output_fixed else bodies[1:]
    bends = [
        f"q_{one}l" if joint.structure_row.output_fixed else f"q_{one}{two}"
        for one, two in zip(bodies, ends, strict=False)
    ]
    return (*bends, *(f"dq_{body}" for body in bodies))


def _row(name: str, fixed: bool) -> Floats:
    if name == "tau":
        return signals(tau=1.0)
    if name.startswith("q_"):
        return signals(**{name: 1.0, "q_l": -1.0})
    return signals(**{name: 1.0, "dq_l": -1.0}) if fixed else signals(**{name: 1.0})


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
    a, b = np.zeros((n + late, n + late)), np.zeros((n + late, len(SIGNALS)))
    a[:n, :n], b[:n] = model.a @ keep, into
    if late == 0:
        b[:n, COMMAND] += model.b
    else:  # the commands on their way, the oldest last
        b[n, COMMAND] = 1.0
        a[range(n + 1, n + late), range(n, n + late - 1)] = 1.0
        a[:n, -1] = model.b
    c, d = [keep, model.tau[None] @ keep, -model.c], [direct, model.tau[None] @ direct, model.rows]
    wide = np.zeros((n + 1 + len(model.c), n + late))
    wide[:, :n] = np.concatenate(c)
    names = (*model.states, "tau", *(f"innovation_{name}" for name in model.outputs))
    return LinearObserver(a, b, wide, np.concatenate(d), names, model.dt)


def check_strictly_stable(observer: LinearObserver, what: str) -> None:
    """Raise ConfigurationError unless the estimation error dies out."""
    if np.max(np.abs(observer.poles())) >= 1.0:
        raise ConfigurationError(f"{what} is not stable: poles {observer.poles()}.")
