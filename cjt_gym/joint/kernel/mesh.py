"""The torque that the gear transmits, and what depends on it: ripple and load-dependent friction.

In a joint with a spring, the torque follows from the deflection and is known before the forces of
the substep. A rigid joint transmits the torque that accelerates its load, which depends on friction
and ripple at the same instant; this algebraic loop is solved. The same is done where a nonlinear
spring may oscillate faster than the substeps, because a ripple that lags behind would excite it.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.kernel.arrays import (
    FREE,
    FREE_SPEED,
    K_M,
    MESH,
    RESIST,
    RIPPLE,
    SPEED,
    SPRING,
    SPRING_ON,
    UNFORCED,
    Floats,
    OneJoint,
    Setup,
    X,
)
from cjt_gym.joint.kernel.compiled import apart, lean
from cjt_gym.joint.kernel.friction import LOAD, dry_level, friction
from cjt_gym.joint.kernel.implicit_solver import resist
from cjt_gym.joint.kernel.load_forces import has_load_force, load_force
from cjt_gym.joint.kernel.resistance import dry_sum, resistance, shift
from cjt_gym.joint.kernel.ripple import GEAR, KIND, ripple_torque
from cjt_gym.joint.kernel.springs import BAR, GEAR_SPRING, has_play, is_nonlinear, linear_spring

PASSES = 40  # in every fourth a bracket is halved
SETTLED, LEAST = 1e-9, 1e-9  # error of the transmitted torque, relative and in [N m]
PREDICTED = 1e-3  # the same of a spring's torque that is as good as solved for
ROUNDING = 1e-15  # of angles


@lean
def meshes(p: Any, ripple: Floats) -> bool:
    """Whether there is a ripple, or friction that grows with the transmitted torque."""
    return bool(
        ripple.shape[0] > 0
        or p.offset_a != 0.0
        or p.offset_b != 0.0
        or p.mu_m + p.mu_g + p.mu_l > 0.0
    )


@apart
def loops(p: Any, ripple: Floats, setup: Setup) -> bool:
    """Whether the transmitted torque is solved for together with what depends on it."""
    feeds_back = False
    for row in range(ripple.shape[0]):
        feeds_back = feeds_back or ripple[row, KIND] == GEAR
    if setup.groups[0] == setup.groups[2]:
        return feeds_back or bool(p.mu_m + p.mu_g + p.mu_l > 0.0)
    nonlinear = is_nonlinear(p, setup.groups, GEAR_SPRING) or is_nonlinear(p, setup.groups, BAR)
    return feeds_back and nonlinear


@lean
def held_friction(joint: OneJoint, command: float) -> float:
    """Return the load's part in the dry friction that holds a rigid joint at rest [N m].

    Friction at rest is known only as a sum; the bodies share it in proportion to their levels.
    """
    rest, _ = resistance(joint, 0, command, 0.0, 1.0)
    hold = joint.work[RESIST, 0] - rest + dry_sum(joint, 0, 1.0)
    side = 1.0 if hold >= 0.0 else -1.0
    own = dry_level(joint, LOAD, side)
    if own == 0.0:
        drag, _ = friction(joint, LOAD, 0.0, side)
        return float(drag)
    return float(hold * own / dry_sum(joint, 0, side))


@apart
def rigid_torque(joint: OneJoint, command: float, load: float, v: float) -> float:
    """Return the mean torque that a rigid joint passed on to its load over a substep [N m]."""
    p, work, h = joint.p, joint.work, joint.setup.h
    if v == 0.0 and p.dq_0 == 0.0:
        drag = held_friction(joint, command)
    else:
        drag, _ = friction(joint, LOAD, v, 1.0 if v >= 0.0 else -1.0)
    if has_load_force(p):
        against, _ = load_force(p, work[X, 0], v, h)
        drag += against
    acceleration = (work[FREE, 1] - work[X, 1]) / h
    return float(p.I_l * acceleration + p.d_l * v + drag - load)


@lean
def mesh_torque(joint: OneJoint) -> float:
    """Return the torque that a gear with a spring transmits, averaged over the substep [N m].

    Row FREE holds the motion, row SPRING what the springs add to their linear torques: both as they
    are, or as predicted by the substep before.
    """
    work, setup = joint.work, joint.setup
    one, other, which = setup.groups[0], setup.groups[1], GEAR_SPRING
    if one == other:
        other, which = setup.groups[2], BAR
    if one == other:
        return 0.0
    if other < 0:
        other = setup.size
    start = work[X, one] - work[X, other]
    end = work[FREE, one] - work[FREE, other]
    torque = 0.0
    if not has_play(joint.p, setup.groups, which):
        stiffness, damping = linear_spring(joint.p, which)
        torque = stiffness * 0.5 * (start + end) + damping * (end - start) / setup.h
    if work[SPRING_ON, which] == 1.0:
        torque += work[SPRING, which]
    return float(torque)


@lean
def middle_angle(joint: OneJoint) -> float:
    """Return the motor angle in the middle of the substep [rad]."""
    work, setup = joint.work, joint.setup
    g = setup.groups[0]
    row = setup.order - setup.size + g
    middle = 0.5 * (work[X, g] + work[FREE, g])
    return float(middle + 0.125 * setup.h * (work[X, row] - work[FREE, row]))


@apart
def settle_mesh(joint: OneJoint, b: Floats) -> None:
    """Find the torque that the gear transmits and the ripple, in memory and work; add the ripple.

    What the gear transmits depends on the motion that friction and ripple themselves cause; both
    are predicted by the substep before, and by a second pass where there was none.
    """
    p, memory, work, setup = joint.p, joint.memory, joint.work, joint.setup
    current = joint.currents[0]
    for _ in range(1 if work[RIPPLE, 1] == 1.0 else 2):
        before = work[RIPPLE, 0]
        shift(joint, b, -1.0)
        for i in range(setup.order):
            work[FREE, i] += b[i, 0] * before
        memory[MESH] = mesh_torque(joint)
        q_m = middle_angle(joint)
        work[RIPPLE, 0] = ripple_torque(p, joint.ripple, q_m, memory[MESH], memory[K_M], current)
        work[RIPPLE, 1] = 1.0
        shift(joint, b, 1.0)
        for i in range(setup.order):
            work[FREE, i] -= b[i, 0] * before
    for i in range(setup.order):
        work[FREE, i] += b[i, 0] * work[RIPPLE, 0]


@apart
def settle_loop(joint: OneJoint, b: Floats, command: float, load: float) -> bool:
    """Find the motion of a joint together with the torque that it transmits.

    Let T(tau) be what the joint transmits when friction and ripple are those of a torque tau.
    Friction of a large tau holds the joint, and ripple is less than all of it, so that T(tau) - tau
    changes sign; secant steps within a bracket find where it vanishes. Its slope is -1 give or take
    the bodies' mu and the ripple's share: while these add up to less than 1, and friction does not
    fall with speed, that is the only solution. Beyond that the joint may both jam and slide (the
    paradox of Painleve); the one found is near the torque and motion of the substep before. The
    ripple is that of the angle which the first pass finds. A spring's torque is predicted by the
    substep before, and taken so if the motion confirms it.

    Returns:
        Whether it was found; then row FREE holds the end of the substep.

    References:
        Brent (1973), Algorithms for Minimization without Derivatives, chapter 4; Genot,
        Brogliato (1999), European Journal of Mechanics A/Solids 18(4).
    """
    p, memory, work, setup = joint.p, joint.memory, joint.work, joint.setup
    g, rigid = setup.groups[0], setup.groups[0] == setup.groups[2]
    least = LEAST + ROUNDING * abs(work[X, g]) / b[g, 2 + g]  # a torque that moves it by rounding
    for i in range(setup.order):
        work[UNFORCED, i] = work[FREE, i]
        work[FREE, i] += b[i, 0] * work[RIPPLE, 0]
    shift(joint, b, -1.0)
    low, high = -math.inf, math.inf
    tau = memory[MESH] if rigid else mesh_torque(joint)
    settled = SETTLED if rigid else PREDICTED
    last_tau, last_gap, q_m = tau, 0.0, 0.0
    for n in range(PASSES):
        memory[MESH] = tau
        if n < 2:
            q_m = middle_angle(joint)
        torque = ripple_torque(p, joint.ripple, q_m, tau, memory[K_M], joint.currents[0])
        for i in range(setup.order):
            work[FREE, i] = work[UNFORCED, i] + b[i, 0] * torque
        for i in range(setup.size):
            work[FREE_SPEED, i] = (work[FREE, i] - work[X, i]) / setup.h
        found = resist(joint, b, command, load)
        shift(joint, b, -1.0)
        if not found:
            return False
        if rigid:
            passed_on = rigid_torque(joint, command, load, work[SPEED, 0])
        else:
            passed_on = mesh_torque(joint)
        gap = passed_on - tau
        if (n > 0 or not rigid) and abs(gap) <= settled * abs(tau) + least:
            work[RIPPLE, 0] = torque
            return True
        if n > 0 and gap > 0.0:
            low = tau
        elif n > 0:
            high = tau
        slope = -1.0
        if n > 0 and tau != last_tau:
            slope = (gap - last_gap) / (tau - last_tau)
        new = tau - gap / slope if slope < 0.0 else tau + gap
        if not low < new < high or n % 4 == 3:
            new = 0.5 * (low + high) if high - low < math.inf else tau + 2.0 * gap
        last_tau, last_gap, tau = tau, gap, new
    return False
