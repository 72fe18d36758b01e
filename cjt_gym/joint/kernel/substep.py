"""One substep of one joint, for all structures, drives and effects.

The linear joint advances exactly for forces that are constant over the substep. Forces that
resist motion are taken at the mean velocity (see `implicit_solver`), forces of position at the
middle of the motion. Currents of drives with inductance advance exactly for half a substep on
either side of the mechanics. The order of convergence is two.
"""

from __future__ import annotations

from cjt_gym.joint.kernel.arrays import (
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
    OneJoint,
    Setup,
    X,
)
from cjt_gym.joint.kernel.compiled import inlined, lean
from cjt_gym.joint.kernel.drives import (
    CURRENT,
    STATIC,
    advance_currents,
    clip,
    shaped_command,
    static_current,
)
from cjt_gym.joint.kernel.implicit_solver import resist
from cjt_gym.joint.kernel.mesh import rigid_torque, settle_loop, settle_mesh
from cjt_gym.joint.kernel.resistance import come_to_rest, remember, shift


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


@inlined
def free_motion(joint: OneJoint, a: Floats, b: Floats, tau_m: float, load: float) -> None:
    """Advance the linear joint from row X to row FREE."""
    setup, work = joint.setup, joint.work
    for i in range(setup.order):
        value = b[i, 0] * tau_m + b[i, 1] * load
        for j in range(setup.order):
            value += a[i, j] * work[X, j]
        work[FREE, i] = value


@inlined
def linear_substep(joint: OneJoint, a: Floats, b: Floats, command: float, load: float) -> None:
    """Do what `substep` does where a current source drives a linear joint with a spring."""
    p, currents, work = joint.p, joint.currents, joint.work
    if work[SWITCH, SHAPES] == 1.0:
        command = shaped_command(p, joint.memory, command, joint.setup.h)
    currents[0] = clip(command, p.i_p)
    free_motion(joint, a, b, p.torque_offset + joint.memory[K_M] * currents[0], load)
    for i in range(joint.setup.order):
        work[X, i] = work[FREE, i]


@inlined
def substep(
    joint: OneJoint,
    a: Floats,
    b: Floats,
    command: float,
    command_d: float,
    load: float,
    last: bool,
) -> float:
    """Advance one joint by h, in place (row X, currents); return the torque if it is rigid.

    Where the equations are not solved, it says so in work and leaves the state as it was, unless
    it is told to take what it has.
    """
    p, memory, currents = joint.p, joint.memory, joint.currents
    work, setup = joint.work, joint.setup
    order, size, drive = setup.order, setup.size, setup.drive
    motor, half = order - size + setup.groups[0], 0.5 * setup.h
    if work[SWITCH, SHAPES] == 1.0:
        command = shaped_command(p, memory, command, setup.h)
    if drive == CURRENT:
        currents[0] = clip(command, p.i_p)
    elif drive != STATIC:
        advance_currents(joint, command, command_d, work[X, motor], half)
    tau_m = p.torque_offset
    if drive != STATIC:
        tau_m += memory[K_M] * currents[0]
    free_motion(joint, a, b, tau_m, load)
    if work[SWITCH, LOOPS] == 1.0:
        solved = settle_loop(joint, b, command, load)
    else:
        if work[SWITCH, MESHES] == 1.0:
            settle_mesh(joint, b)
        solved = True
        if work[SWITCH, RESISTS] == 1.0:
            for g in range(size):
                work[FREE_SPEED, g] = (work[FREE, g] - work[X, g]) / setup.h
            solved = resist(joint, b, command, load)
            shift(joint, b, -1.0)
    work[SWITCH, UNSOLVED] = 0.0 if solved else 1.0
    if not (solved or last):
        return 0.0
    if work[SWITCH, RESISTS] == 1.0 and p.dq_0 == 0.0:
        come_to_rest(joint, b)
    tau = 0.0
    if setup.groups[1] == setup.groups[2]:
        v = (work[FREE, 0] - work[X, 0]) / setup.h
        tau = rigid_torque(joint, command, load, v)
    if drive == STATIC:
        g = setup.groups[0]
        v = (work[FREE, g] - work[X, g]) / setup.h
        currents[0], _ = static_current(p, memory[K_M], memory[R_W], command, setup.is_voltage, v)
    elif drive != CURRENT:
        advance_currents(joint, command, command_d, work[FREE, motor], half)
    if work[SWITCH, REMEMBERS] == 1.0:
        remember(joint)
    for i in range(order):
        work[X, i] = work[FREE, i]
    return tau
