"""The sampled linear mechanics of a joint, from motor torque to what is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.linear_law import MEASURED
from cjt_gym.joint import Joint
from cjt_gym.joint.linear import state_matrices, zero_order_hold


@dataclass(frozen=True)
class Mechanics:
    """The joint without its absolute position: deflections, then velocities.

        x[k+1] = a x[k] + b u[k],  tau = c_tau x,  dq = c_dq x,  deflections = c_q x

    With a free load the deflections are (q_m - q_g, q_g - q_l) or (q_m - q_l), with a fixed output
    they count from q_l, which stands still.
    """

    a: Floats  # shape (order, order)
    b: Floats  # motor torque, shape (order,)
    c: Floats  # rows of `MEASURED` with angles from q_l, shape (7, order)
    continuous: tuple[Floats, Floats]  # the same (a, b) before sampling
    fixed: bool  # whether the output is fixed
    dt: float  # sample time [s]

    def row(self, name: str) -> Floats:
        """Return the output row of a measured signal, shape (order,)."""
        return np.asarray(self.c[MEASURED.index(name)])


def mechanics(joint: Joint, dt: float) -> Mechanics:
    """Return the sampled mechanics of a joint; without a torsion bar its row of tau is zero."""
    a, b, rows, _ = state_matrices(joint.parameters, joint.structure_row)
    size = joint.structure_row.size
    order = a.shape[0]
    position, velocity = np.arange(size), np.arange(order - size, order)
    if joint.structure_row.output_fixed:
        relative = np.eye(size)
    else:
        relative = np.eye(size - 1, size) - np.eye(size - 1, size, 1)
    back = np.linalg.pinv(relative)
    if not joint.structure_row.output_fixed:
        back -= back[-1]  # angles from the load
    bends = len(relative)
    continuous = np.zeros((bends + size, bends + size))
    continuous[:bends, bends:] = relative
    continuous[bends:, :bends] = a[np.ix_(velocity, position)] @ back
    continuous[bends:, bends:] = a[np.ix_(velocity, velocity)]
    drive = np.concatenate([np.zeros(bends), b[velocity, 0]])
    c = np.concatenate([rows[:, position] @ back, rows[:, velocity]], axis=1)
    a_d, b_d = zero_order_hold(continuous, drive[:, None], dt)
    fixed = joint.structure_row.output_fixed
    return Mechanics(a_d, b_d[:, 0], np.roll(c, 1, axis=0), (continuous, drive), fixed, dt)


def placed(model: Mechanics) -> Mechanics:
    """Return mechanics with a free load and, as the last state, the position of the last body."""
    (a, b), n = model.continuous, len(model.b)
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n], wide[n, n - 1] = a, 1.0  # the last velocity is that of the last body
    into = np.append(b, 0.0)
    angle = np.array([[float(name.startswith("q_"))] for name in MEASURED])
    a_d, b_d = zero_order_hold(wide, into[:, None], model.dt)
    c = np.concatenate([model.c, angle], axis=1)
    return Mechanics(a_d, b_d[:, 0], c, (wide, into), model.fixed, model.dt)


def with_commands(a: Floats, b: Floats, delay: int) -> tuple[Floats, Floats]:
    """Return a system with the commands on their way as states, the newest first."""
    n = len(b)
    if delay == 0:
        return a, b
    wide, into = np.zeros((n + delay, n + delay)), np.zeros(n + delay)
    wide[:n, :n], wide[:n, -1] = a, b
    wide[range(n + 1, n + delay), range(n, n + delay - 1)] = 1.0
    into[n] = 1.0
    return wide, into
