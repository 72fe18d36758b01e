"""The arrays that the kernel works on, and what their columns and rows mean."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


CHANNELS = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
CURRENT_I, Q_M, Q_G, Q_L, DQ_M, DQ_G, DQ_L, TAU = range(8)

# Rows of the scratch array of one substep, shape (13, 8), so that none is allocated in it.
X = 0  # state at the start of the substep
FREE = 1  # state at its end
SPEED = 2  # mean velocities of the coordinates
FREE_SPEED = 3  # the same without resisting torques
RESIST = 4  # resisting torques
GUESS = 5  # mean velocities of the substep before, from which the search starts
REST = 6  # residuals of the search
SLOPE = 7  # slopes of the resisting torques
ACTIVE = 8  # 1 where anything resists a coordinate
JACOBIAN = 9  # three rows
RIPPLE = 12  # ripple torque of the substep before, and 1 where there was one
WORK_ROWS, WORK_WIDTH = 13, 8


class Setup(NamedTuple):
    """What all joints of a batch share.

    Attributes:
        groups: Coordinate of motor, gear and load, -1 for a prescribed load.
        size: Number of coordinates.
        order: Number of mechanical states.
        drive: Number of the drive.
        is_voltage: Whether commands are voltages [V]; else currents [A].
        h: Substep [s].
        substeps: Substeps per control step.
        dt: Control step [s].
    """

    groups: tuple[int, int, int]
    size: int
    order: int
    drive: int
    is_voltage: bool
    h: float
    substeps: int
    dt: float


class Batch(NamedTuple):
    """The arrays of n joints; the kernel changes all but p, ripple, a and b.

    Attributes:
        p: Parameter records, shape (n,).
        ripple: Rows [f, a, b, kind], shape (n, rows, 4).
        a: Discrete system matrix of a substep, shape (n, order, order).
        b: Its inputs: motor torque, load input, torque per coordinate; (n, order, 2 + size).
        state: [q_m q_g q_l dq_m dq_g dq_l], shape (n, 6) [rad, rad/s].
        currents: [i_q, i_d], shape (n, 2) [A].
        tau: Transmitted joint torque, shape (n,) [N m].
        snapshot: Channel values within the step for all channels and for tau, shape (n, 2, 8).
        commands: Ring of the last commands (q and d axis), shape (n, depth, 2).
        outputs: Ring of the last true channel values, shape (n, depth, 8).
        measured: Latest measured channel values, shape (n, 8).
        samples: Control steps since reset, shape (n,).
        rng: Random streams, shape (n,).
    """

    p: Any
    ripple: Floats
    a: Floats
    b: Floats
    state: Floats
    currents: Floats
    tau: Floats
    snapshot: Floats
    commands: Floats
    outputs: Floats
    measured: Floats
    samples: Integers
    rng: NDArray[np.uint64]
