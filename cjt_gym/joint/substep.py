"""One substep of one joint, for all structures, drives and effects.

The linear joint advances exactly for forces that are constant over the substep. Forces that
resist motion are taken at the mean velocity (see `implicit_solver`), forces of position at the
middle of the motion. Currents of drives with inductance advance exactly for half a substep on
either side of the mechanics. The order of convergence is two.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.joint.arrays import (
    FREE,
    FREE_SPEED,
    K_M,
    LOOPS,
    MESHES,
    R_W,
    REMEMBERS,
    RESISTS,
    SHAPES,
    SWITCH,
    UNSOLVED,
    Floats,
    Setup,
    X,
)
from cjt_gym.joint.compiled import lean
from cjt_gym.joint.drives import (
    CURRENT,
    STATIC,
    advance_currents,
    clip,
    shaped_command,
    static_current,
)
from cjt_gym.joint.implicit_solver import resist
from cjt_gym.joint.mesh import rigid_torque, settle_loop, settle_mesh
from cjt_gym.joint.resistance import come_to_rest, remember, shift


@lean
def load_state(setup: Setup, state: Floats, x: Floats) -> None:
    """Copy the bodies' state, shape (6,), into the structure's own, shape (order,).

    Of bodies that are one mass the first counts.
    """
    for body in (2, 1, 0):
        g = setup.groups[body]
        if g >= 0:
            x[g] = state[body]
            x[setup.order - setup.size + g] = state[3 + body]
        else:
            x[setup.size] = state[body]


@lean
def store_state(setup: Setup, x: Floats, load: float, state: Floats) -> None:
    """Copy the structure's state back to the bodies; `load` is the velocity of a fixed one."""
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            state[body] = x[g]
            state[3 + body] = x[setup.order - setup.size + g]
        else:
            state[body] = x[setup.size]
            state[3 + body] = load


@lean
def free_motion(
    a: Floats, b: Floats, setup: Setup, tau_m: float, load: float, work: Floats
) -> None:
    """Advance the linear joint from row X to row FREE."""
    for i in range(setup.order):
        value = b[i, 0] * tau_m + b[i, 1] * load
        for j in range(setup.order):
            value += a[i, j] * work[X, j]
        work[FREE, i] = value


@lean
def linear_substep(
    p: Any,
    memory: Floats,
    a: Floats,
    b: Floats,
    setup: Setup,
    currents: Floats,
    command: float,
    load: float,
    work: Floats,
) -> None:
    """Do what `substep` does where a current source drives a linear joint with a spring."""
    currents[0] = clip(command, p.i_p)
    free_motion(a, b, setup, p.torque_offset + memory[K_M] * currents[0], load, work)
    for i in range(setup.order):
        work[X, i] = work[FREE, i]


@lean
def substep(
    p: Any,
    memory: Floats,
    ripple: Floats,
    a: Floats,
    b: Floats,
    setup: Setup,
    currents: Floats,
    command: float,
    command_d: float,
    load: float,
    work: Floats,
    last: bool,
) -> float:
    """Advance one joint by h, in place (row X, currents); return the torque if it is rigid.

    Where the equations are not solved, it says so in work and leaves the state as it was, unless
    it is told to take what it has.
    """
    order, size, drive = setup.order, setup.size, setup.drive
    motor, half = order - size + setup.groups[0], 0.5 * setup.h
    is_voltage, k, r = setup.is_voltage, memory[K_M], memory[R_W]
    if work[SWITCH, SHAPES] == 1.0:
        command = shaped_command(p, memory, command, setup.h)
    if drive == CURRENT:
        currents[0] = clip(command, p.i_p)
    elif drive != STATIC:
        dq_m = work[X, motor]
        advance_currents(p, k, r, drive, currents, command, command_d, is_voltage, dq_m, half)
    tau_m = p.torque_offset
    if drive != STATIC:
        tau_m += k * currents[0]
    free_motion(a, b, setup, tau_m, load, work)
    if work[SWITCH, LOOPS] == 1.0:
        solved = settle_loop(p, memory, ripple, b, setup, command, load, currents[0], work)
    else:
        if work[SWITCH, MESHES] == 1.0:
            settle_mesh(p, memory, ripple, b, setup, currents[0], work)
        solved = True
        if work[SWITCH, RESISTS] == 1.0:
            for g in range(size):
                work[FREE_SPEED, g] = (work[FREE, g] - work[X, g]) / setup.h
            solved = resist(p, memory, setup, b, command, load, work)
            shift(b, setup, -1.0, work)
    work[SWITCH, UNSOLVED] = 0.0 if solved else 1.0
    if not (solved or last):
        return 0.0
    if work[SWITCH, RESISTS] == 1.0 and p.dq_0 == 0.0:
        come_to_rest(p, memory, setup, b, work)
    tau = 0.0
    if setup.groups[1] == setup.groups[2]:
        v = (work[FREE, 0] - work[X, 0]) / setup.h
        tau = rigid_torque(p, memory, setup, command, load, v, work)
    if drive == STATIC:
        g = setup.groups[0]
        v = (work[FREE, g] - work[X, g]) / setup.h
        currents[0], _ = static_current(p, k, r, command, is_voltage, v)
    elif drive != CURRENT:
        dq_m = work[FREE, motor]
        advance_currents(p, k, r, drive, currents, command, command_d, is_voltage, dq_m, half)
    if work[SWITCH, REMEMBERS] == 1.0:
        remember(p, memory, setup, work)
    for i in range(order):
        work[X, i] = work[FREE, i]
    return tau
