"""Estimate of the states that a record lacks, by a steady-state Kalman filter of the joint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.prediction.angle_noise import angle_noise
from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.model import motor_inertia
from cjt_gym.gap.stages.chain import GEAR, LOAD, MOTOR, Chain, Link, build_chain, kalman_gain
from cjt_gym.joint import Joint
from cjt_gym.joint.batch import JointBatch
from cjt_gym.joint.kernel.arrays import Batch, Floats, Setup
from cjt_gym.joint.kernel.compiled import threaded
from cjt_gym.joint.kernel.control_steps import one_step, restart

Flags = NDArray[np.bool_]
ANGLES = ("q_m", "q_g", "q_l")
CONSTANT = 1e-9
"""Standard deviation of an input, relative to its peak, that may be rounding."""
UNMODELLED = 0.1
"""White torque on motor and load that the model lacks, relative to the rms torque of the motor, or
to that of its inertia if nothing drives it. With a tenth of it the errors of six right joints 0.1 s
ahead were 0.5 to 1.8 times as large."""


class Given(NamedTuple):
    """What a record gives to the kernel.

    Attributes:
        commands: Currents [A] or voltages [V], shape (N,).
        loads: Load torque [N m] or velocity [rad/s], shape (N,).
        states: Measured or estimated states, shape (N, 6).
    """

    commands: Floats
    loads: Floats
    states: Floats


@threaded
def follow(
    batch: Batch,
    setup: Setup,
    given: Given,
    seen: tuple[Floats, Flags],
    gain: Floats,
    work: Floats,
    out: Floats,
) -> None:
    """Predict the states a sample ahead and correct them by the measured angles.

    The estimate restarts where the record is broken and where a state is no longer finite.

    Args:
        batch: A batch of one.
        setup: Its setup.
        given: The record, with the states to start from.
        seen: Measured angles of motor, gear and load, shape (N, 3), and where the record is not
            broken, shape (N,).
        gain: Change of the six states with the three errors; zero for angles not measured.
        work: Scratch space.
        out: Receives the states, shape (N, 6).
    """
    (commands, loads, states), (angles, whole) = given, seen
    state = batch.state[0]
    only = 0 * len(states)  # for a literal 0, `one_step` would be compiled once more
    good = False
    for k in range(states.shape[0]):
        if good:
            motor, gear, load = (
                angles[k, 0] - state[0],
                angles[k, 1] - state[1],
                angles[k, 2] - state[2],
            )
            for j in range(6):
                state[j] += gain[j, 0] * motor + gain[j, 1] * gear + gain[j, 2] * load
        else:
            for j in range(6):
                state[j] = states[k, j]
            restart(batch, setup, 0, loads[k], work)
        for j in range(6):
            out[k, j] = state[j]
        good = whole[k] and one_step(batch, setup, only, commands[k], 0.0, loads[k], work)


def observed(joint: Joint, batch: JointBatch, log: Log, given: Given, work: Floats) -> Floats:
    """Return the states of a record, shape (N, 6), as a joint's filter estimates them.

    Args:
        joint: The joint.
        batch: It as a batch of one.
        log: The record.
        given: It for the kernel.
        work: Scratch space.
    """
    out, gain = np.empty_like(log.states), _gain(joint, batch, log)
    follow(batch.arrays, batch.setup, given, (log.angles, log.whole), gain, work, out)
    return out


def _gain(joint: Joint, batch: JointBatch, log: Log) -> Floats:
    """Return the filter's gain for the bodies' states, shape (6, 3).

    Where no angle was measured, those that follow from the torque stand for it.
    """
    groups, p = joint.structure_row.groups, joint.parameters
    chain = _chain(groups, batch.arrays.p[0], log.dt)
    free = [k for k in range(3) if groups[k] >= 0]
    seen = [k for k in free if ANGLES[k] in log.measured]
    seen = seen or [max(k for k in free if log.known[k])]
    unit = p.k_t * p.n / (p.r if log.voltage else 1.0)
    command = log.command[log.whole]
    torque = unit * float(np.std(command))
    if torque <= CONSTANT * unit * float(np.abs(command).max()):
        torque = motor_inertia(joint) * float(np.std(log.acceleration))
    torque *= UNMODELLED
    noise = [angle_noise(log.angles[:, k]) for k in seen]
    gain = np.zeros((6, 3))
    found = kalman_gain(chain, [groups[k] for k in seen], (torque, 0.0, torque), noise)
    for body, group in enumerate(groups):
        if group >= 0:
            gain[body, seen], gain[body + 3, seen] = found[group], found[group + chain.size]
    return gain


def _chain(groups: tuple[int, int, int], p: np.void, dt: float) -> Chain:
    """Return a joint without its nonlinear effects over one sample; a held load is no state."""
    bodies = (MOTOR, GEAR, LOAD)
    ends = [body if groups[body] >= 0 else None for body in bodies]
    springs = ((p["k_g"], p["d_mg"]), (p["k_b"], p["d_gl"]))
    links = [
        Link(ends[k], ends[k + 1], float(stiffness), float(damping))
        for k, (stiffness, damping) in enumerate(springs)
        if groups[k] != groups[k + 1]
    ]
    inertia, damping = ([float(p[f"{x}_{b}"]) for b in "mgl"] for x in "Id")
    return build_chain(groups, inertia, damping, links, dt)
