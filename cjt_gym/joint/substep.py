"""One substep of one joint, for all structures, drives and effects.

The linear joint advances exactly for forces that are constant over the substep. Forces that
resist motion are taken at the mean velocity (see `resist`), forces of position at the middle
of the motion. Currents of drives with inductance advance exactly for half a substep on either
side of the mechanics. The order of convergence is two.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.joint.arrays import FREE, FREE_SPEED, RESIST, RIPPLE, Floats, Setup, X
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.drives import CURRENT, STATIC, advance_currents, clip, static_current
from cjt_gym.joint.friction import LOAD, friction
from cjt_gym.joint.resist import come_to_rest, coulomb_sum, resist, shift
from cjt_gym.joint.ripple import ripple_torque

RIGID_PASSES = 4


@compiled
def load_state(setup: Setup, state: Floats, x: Floats) -> None:
    """Copy the bodies' state, shape (6,), into the structure's own, shape (order,)."""
    for body in range(3):
        g = setup.groups[body]
        if g >= 0:
            x[g] = state[body]
            x[setup.order - setup.size + g] = state[3 + body]
        else:
            x[setup.size] = state[body]


@compiled
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


@compiled
def rigid_torque(p: Any, setup: Setup, load: float, work: Floats) -> float:
    """Return the mean torque that a rigid joint passed on to its load over a substep [N m]."""
    v = (work[FREE, 0] - work[X, 0]) / setup.h
    side = 1.0 if v >= 0.0 else -1.0
    drag, _ = friction(p, LOAD, v, side)
    if v == 0.0 and p.dq_0 == 0.0:
        total = coulomb_sum(p, setup.groups, 0, side)
        drag = work[RESIST, 0] * abs(drag) / total if total > 0.0 else 0.0
    acceleration = (work[FREE, 1] - work[X, 1]) / setup.h
    return float(p.I_l * acceleration + p.d_l * v + drag - load)


@compiled
def mesh_torque(p: Any, setup: Setup, load: float, work: Floats) -> float:
    """Return the torque that the gear transmits, averaged over the substep [N m].

    Row FREE holds the motion under the resisting torques of the substep before.
    """
    one, other = setup.groups[0], setup.groups[1]
    stiffness, damping = p.k_g, p.d_mg
    if one == other:
        other = setup.groups[2]
        stiffness, damping = p.k_b, p.d_gl
    if one == other:
        return rigid_torque(p, setup, load, work)
    if other < 0:
        other = setup.size
    start = work[X, one] - work[X, other]
    end = work[FREE, one] - work[FREE, other]
    return float(stiffness * 0.5 * (start + end) + damping * (end - start) / setup.h)


@compiled
def position_torque(p: Any, ripple: Floats, setup: Setup, tau: float, work: Floats) -> float:
    """Return the torque on the motor that depends on position, at the middle of the substep."""
    g = setup.groups[0]
    row = setup.order - setup.size + g
    middle = 0.5 * (work[X, g] + work[FREE, g])
    q_m = middle + 0.125 * setup.h * (work[X, row] - work[FREE, row])
    return ripple_torque(ripple, q_m, tau, p.cogging_scale, p.gear_ripple_scale)


@compiled
def settled_ripple(
    p: Any, ripple: Floats, b: Floats, setup: Setup, load: float, work: Floats
) -> float:
    """Return the ripple torque of a substep [N m].

    What the gear transmits depends on the motion that friction and ripple themselves cause; both
    are predicted by the substep before, and by a second pass where there was none. A rigid joint
    transmits a torque that depends on this one at the same instant: it takes more passes, each of
    which reduces the error by the ripple's share of the torque.
    """
    passes = 1 if work[RIPPLE, 1] == 1.0 else 2
    if setup.groups[0] == setup.groups[2]:
        passes = RIGID_PASSES
    work[RIPPLE, 1] = 1.0
    for _ in range(passes):
        before = work[RIPPLE, 0]
        shift(b, setup, -1.0, work)
        for i in range(setup.order):
            work[FREE, i] += b[i, 0] * before
        torque = position_torque(p, ripple, setup, mesh_torque(p, setup, load, work), work)
        shift(b, setup, 1.0, work)
        for i in range(setup.order):
            work[FREE, i] -= b[i, 0] * before
        work[RIPPLE, 0] = torque
    return float(work[RIPPLE, 0])


@compiled
def substep(
    p: Any,
    ripple: Floats,
    a: Floats,
    b: Floats,
    setup: Setup,
    currents: Floats,
    command: float,
    command_d: float,
    load: float,
    work: Floats,
) -> float:
    """Advance one joint by h, in place (row X, currents); return the torque if it is rigid.

    Args:
        p: Parameter record.
        ripple: Its ripple rows, shape (rows, 4).
        a: Discrete system matrix, shape (order, order).
        b: Discrete inputs, shape (order, 2 + size).
        setup: What the batch shares.
        currents: [i_q, i_d] [A].
        command: Current [A] or voltage [V] on the q axis.
        command_d: Voltage on the d axis [V].
        load: Load torque [N m] or, where the output is fixed, load velocity [rad/s].
        work: Scratch rows, with the state in row X.
    """
    order, size, drive = setup.order, setup.size, setup.drive
    motor, half = order - size + setup.groups[0], 0.5 * setup.h
    is_voltage = setup.is_voltage
    if drive == CURRENT:
        currents[0] = clip(command, p.i_p)
    elif drive != STATIC:
        advance_currents(p, drive, currents, command, command_d, is_voltage, work[X, motor], half)
    tau_m = p.torque_offset
    if drive != STATIC:
        tau_m += p.k_t * p.n * currents[0]
    for i in range(order):
        value = b[i, 0] * tau_m + b[i, 1] * load
        for j in range(order):
            value += a[i, j] * work[X, j]
        work[FREE, i] = value
    if ripple.shape[0] > 0:
        extra = settled_ripple(p, ripple, b, setup, load, work)
        for i in range(order):
            work[FREE, i] += b[i, 0] * extra
    for g in range(size):
        work[FREE_SPEED, g] = (work[FREE, g] - work[X, g]) / setup.h
    if resist(p, setup, b, command, work):
        shift(b, setup, -1.0, work)
        if p.dq_0 == 0.0:
            come_to_rest(p, setup, b, work)
    rigid = setup.groups[1] == setup.groups[2]
    tau = rigid_torque(p, setup, load, work) if rigid else 0.0
    if drive == STATIC:
        g = setup.groups[0]
        v = (work[FREE, g] - work[X, g]) / setup.h
        currents[0], _ = static_current(p, command, is_voltage, v)
    elif drive != CURRENT:
        dq_m = work[FREE, motor]
        advance_currents(p, drive, currents, command, command_d, is_voltage, dq_m, half)
    for i in range(order):
        work[X, i] = work[FREE, i]
    return tau
