"""The arrays that the kernel works on, and the meaning of their columns and rows.

Compiled functions call things alike: `batch` all joints and `i` one of them, `setup` what they
share; `joint` one of them while it is stepped, `p` its parameters, `memory` what its effects
remember, `work` its scratch rows; `body` MOTOR, GEAR or LOAD, `which` GEAR_SPRING or BAR, `drive`
the number of the drive; angles and deflections [rad], `dq` and `rate` velocities [rad/s], `side`
the direction of motion, +1 or -1, which counts at rest; `tau` the transmitted torque [N m], `load`
the load torque [N m] or, where the output is fixed, its velocity [rad/s]; `command` on the q axis
and `command_d` on the d axis, current [A] or voltage [V]; `k` torque per ampere [N m/A], `r`
resistance of the winding [Ohm]; `h` the substep [s]; `keep` whether to keep a new state of the
hysteresis, `held` 1 to start from the one in memory, 0 to start relaxed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]

CHANNELS = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")
CURRENT_I, Q_M, Q_G, Q_L, DQ_M, DQ_G, DQ_L, TAU = range(8)

# Rows of the scratch array of one joint, shape (56, 8), so that none is allocated in a step.
X = 0  # state at the start of the substep
FREE = 1  # state at its end
SPEED = 2  # mean velocities of the coordinates
FREE_SPEED = 3  # the same without resisting torques
RESIST = 4  # resisting torques
GUESS = 5  # mean velocities of the substep before, from which the search starts
REST = 6  # residuals of the search
SLOPE = 7  # slopes of the resisting torques
ACTIVE = 8  # what resists a coordinate: nothing, Coulomb friction alone, anything
JACOBIAN = 9  # three rows
RIPPLE = 12  # ripple torque of the substep before, and 1 where there was one
SPRING = 13  # torques that gear and bar add to their linear ones
SPRING_SLOPE = 14  # their slopes over the mean velocity
SPRING_ON = 15  # 1 where they add any
LATE = 16  # whole control steps by which each channel is late
LATE_SUB = 17  # substeps on top of them
SWITCH = 18  # what a substep has to do beyond the linear motion, 1 or 0 in the columns below
SHAPES, MESHES, LOOPS, RESISTS, REMEMBERS, UNSOLVED, LINEAR = range(7)
BODY = 19  # friction of motor, gear and load: three rows with the columns below
UP, DOWN, EXCESS, MU, SIGMA, EXTRA, LAW = 0, 1, 2, 3, 4, 5, 6
OLD = 22  # measured channels of the control step before
MODE = 23  # of coordinates with sharp friction: held, or sliding one way; or not sharp
SAVED = 24  # what a substep may have to undo
UNFORCED = 25  # end of the substep without ripple and resisting torques
FINE, FINE_ROWS = 26, 30  # matrices of shorter substeps and space to compute them
WORK_ROWS, WORK_WIDTH = 56, 8

# What a joint remembers beyond its mechanical state and its currents.
BRISTLE = 0  # deflection of the bristles of motor, gear and load [rad]
LOOP = 3  # hysteresis of the bar: Bouc-Wen state [-] or deflections of eight elements [rad]
WINDING, HOUSING = 11, 12  # temperatures above ambient [K]
K_M, R_W = 13, 14  # torque per ampere k_t n [N m/A] and winding resistance [Ohm], as warm as now
REFERENCE = 15  # current behind the rate limit [A]
LAGGED = 16  # current behind the lag [A]
DRIFT = 17  # zeros of i, q_m, q_g, q_l, tau
VOLUNTARY = 22  # torque of a person [N m]
TREMOR = 23  # its tremor, two numbers [N m]
MESH = 25  # torque that the gear transmits [N m]
REGULATOR = 26  # integrals of the current controller on q and d axis [A s]; behind them:
VOLTS = 28  # voltages at the winding on q and d axis [V]
MEMORY = 30


class Setup(NamedTuple):
    """What all joints of a batch share."""

    groups: tuple[int, int, int]  # coordinate of motor, gear and load, -1 for a prescribed load
    size: int  # number of coordinates
    order: int  # number of mechanical states
    drive: int
    is_voltage: bool  # whether commands are voltages [V]; else currents [A]
    h: float  # substep [s]
    substeps: int  # substeps per control step
    dt: float  # control step [s]


class OneJoint(NamedTuple):
    """A joint of a batch while it is stepped; row X of `work` is its mechanical state."""

    p: Any  # its parameter record
    memory: Floats  # what its effects remember
    ripple: Floats  # rows [f, a, b, kind]
    currents: Floats  # [i_q, i_d] [A]
    work: Floats  # scratch rows
    setup: Setup


class Batch(NamedTuple):
    """The arrays of n joints; the kernel changes all but p, ripple, a and b."""

    p: Any  # parameter records, shape (n,)
    ripple: Floats  # rows [f, a, b, kind], shape (n, rows, 4)
    a: Floats  # discrete system matrix of a substep, shape (n, order, order)
    b: Floats  # its inputs: motor torque, load input, torque per coordinate; (n, order, 2 + size)
    state: Floats  # [q_m q_g q_l dq_m dq_g dq_l], shape (n, 6) [rad, rad/s]
    memory: Floats  # what effects remember, and behind it the table of the bar; (n, MEMORY or more)
    currents: Floats  # [i_q, i_d], shape (n, 2) [A]
    tau: Floats  # transmitted joint torque, shape (n,) [N m]
    # channel values at the instants within the step that are reported, shape (n, 8)
    snapshot: Floats
    commands: Floats  # ring of the last commands (q and d axis), shape (n, depth, 2)
    outputs: Floats  # ring of the last true channel values, shape (n, depth, 8)
    measured: Floats  # latest measured channel values, shape (n, 8)
    samples: Integers  # control steps since reset, shape (n,)
    rng: NDArray[np.uint64]  # random streams, shape (n,)
