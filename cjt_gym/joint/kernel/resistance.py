"""The forces that resist the motion of each coordinate, and the states that they leave.

Friction of the bodies, weight and contact, and the voltage limit of a drive without inductance add
up per coordinate; what springs add to their linear models acts between two.
"""

from __future__ import annotations

from cjt_gym.joint.kernel.arrays import (
    ACTIVE,
    BODY,
    BRISTLE,
    FREE,
    GUESS,
    K_M,
    LAW,
    R_W,
    RESIST,
    SPEED,
    SPRING,
    SPRING_ON,
    Floats,
    OneJoint,
    Setup,
    X,
)
from cjt_gym.joint.kernel.compiled import apart, inlined, lean
from cjt_gym.joint.kernel.drives import STATIC, static_current
from cjt_gym.joint.kernel.friction import (
    BRISTLES,
    COULOMB,
    LOAD,
    NONE,
    coulomb_friction,
    dry_level,
    friction,
    note_friction,
    own_bristles,
)
from cjt_gym.joint.kernel.load_forces import has_load_force, load_force
from cjt_gym.joint.kernel.springs import BAR, added_torque, is_nonlinear

FREELY, PLAINLY, ANY = 0.0, 1.0, 2.0  # what resists a coordinate


@lean
def resistance(
    joint: OneJoint, g: int, command: float, v: float, side: float
) -> tuple[float, float]:
    """Return the resisting torque on coordinate g at mean velocity v, and its slope."""
    p, memory, work, setup = joint.p, joint.memory, joint.work, joint.setup
    torque, slope = 0.0, 0.0
    for body in range(3):
        if setup.groups[body] == g and work[BODY + body, LAW] != NONE:
            t, s = friction(joint, body, v, side)
            torque += t
            slope += s
    if setup.groups[LOAD] == g and has_load_force(p):
        t, s = load_force(p, work[X, g], v, setup.h)
        torque += t
        slope += s
    if setup.drive == STATIC and setup.groups[0] == g:
        k = memory[K_M]
        current, s = static_current(p, k, memory[R_W], command, setup.is_voltage, v)
        torque -= k * current
        slope -= k * s
    return torque, slope


@inlined
def plain_resistance(joint: OneJoint, g: int, v: float, side: float) -> tuple[float, float]:
    """Return what `resistance` does if there is only Coulomb friction."""
    torque, slope = 0.0, 0.0
    for body in range(3):
        if joint.setup.groups[body] == g:
            t, s = coulomb_friction(joint.p.dq_0, joint.work, BODY + body, v, side)
            torque += t
            slope += s
    return torque, slope


@lean
def kind_of_resistance(joint: OneJoint, g: int) -> float:
    """Return whether nothing, Coulomb friction alone, or anything resists coordinate g."""
    setup = joint.setup
    if setup.groups[LOAD] == g and has_load_force(joint.p):
        return ANY
    if setup.drive == STATIC and setup.groups[0] == g:
        return ANY
    kind = FREELY
    for body in range(3):
        if setup.groups[body] == g:
            law = joint.work[BODY + body, LAW]
            if law > COULOMB:
                return ANY
            if law == COULOMB:
                kind = PLAINLY
    return kind


@lean
def prepare(joint: OneJoint, command: float, load: float) -> None:
    """Determine what resists, and guess mean velocities and torques from the present state."""
    p, work, setup = joint.p, joint.work, joint.setup
    note_friction(p, work)
    for g in range(setup.size):
        work[ACTIVE, g] = kind_of_resistance(joint, g)
        work[GUESS, g] = work[X, setup.order - setup.size + g]
    for which in range(2):
        on = is_nonlinear(p, setup.groups, which)
        work[SPRING_ON, which] = 1.0 if on else 0.0
        work[SPRING, which] = 0.0
        if on:
            one, other = setup.groups[which], setup.groups[which + 1]
            work[ACTIVE, one] = max(work[ACTIVE, one], PLAINLY)
            if other >= 0:
                work[ACTIVE, other] = max(work[ACTIVE, other], PLAINLY)
            start, rate = deflection(joint, which, load, GUESS)
            added, _ = added_torque(p, joint.memory, setup, which, start, rate, False)
            work[SPRING, which] = added
    for g in range(setup.size):
        if work[ACTIVE, g] != FREELY:
            v = work[GUESS, g]
            up, down = 1.0 if v >= 0.0 else -1.0, 1.0 if v > 0.0 else -1.0
            ahead, _ = resistance(joint, g, command, v, up)
            back, _ = resistance(joint, g, command, v, down)
            work[RESIST, g] = 0.5 * (ahead + back)  # at rest neither direction is preferred
        else:
            work[RESIST, g] = 0.0


@lean
def deflection(joint: OneJoint, which: int, load: float, row: int) -> tuple[float, float]:
    """Return a spring's deflection at the start and its mean rate, from the speeds in a row."""
    setup, work = joint.setup, joint.work
    one, other = setup.groups[which], setup.groups[which + 1]
    if other < 0:
        return work[X, one] - work[X, setup.size], work[row, one] - load
    return work[X, one] - work[X, other], work[row, one] - work[row, other]


@lean
def mobility(setup: Setup, b: Floats, g: int, which: int) -> float:
    """Return the mean velocity that a unit torque of a spring takes from coordinate g."""
    one, other = setup.groups[which], setup.groups[which + 1]
    w = b[g, 2 + one]
    if other >= 0:
        w -= b[g, 2 + other]
    return float(w / setup.h)


@inlined
def dry_sum(joint: OneJoint, g: int, side: float) -> float:
    """Return the set-valued friction that can hold coordinate g [N m]."""
    total = 0.0
    for body in range(3):
        if joint.setup.groups[body] == g:
            total += dry_level(joint, body, side)
    return total


@lean
def shift(joint: OneJoint, b: Floats, sign: float) -> None:
    """Add the effect of the torques in rows RESIST and SPRING to the end of the substep."""
    setup, work = joint.setup, joint.work
    for g in range(setup.size):
        if work[ACTIVE, g] != FREELY:
            torque = work[RESIST, g]
            for which in range(2):
                if work[SPRING_ON, which] == 1.0:
                    if setup.groups[which] == g:
                        torque += work[SPRING, which]
                    elif setup.groups[which + 1] == g:
                        torque -= work[SPRING, which]
            for i in range(setup.order):
                work[FREE, i] += sign * b[i, 2 + g] * torque


@lean
def come_to_rest(joint: OneJoint, b: Floats) -> None:
    """Hold the coordinates that sharp friction has stopped: exact position, no velocity.

    A coordinate is held if it did not move in the mean, or if it turned within the substep
    although friction could have held it. Both only take kinetic energy away.
    """
    setup, work = joint.setup, joint.work
    for g in range(setup.size):
        up = dry_sum(joint, g, 1.0)
        down = dry_sum(joint, g, -1.0)
        if up + down == 0.0:
            continue
        row = setup.order - setup.size + g
        if work[SPEED, g] == 0.0:
            work[FREE, g], work[FREE, row] = work[X, g], 0.0
        elif work[FREE, row] * work[SPEED, g] < 0.0:
            dry = up if work[SPEED, g] > 0.0 else -down
            needed = (work[FREE, row] - work[X, row]) / b[row, 2 + g] + dry
            if -down <= needed <= up:
                work[FREE, row] = 0.0


@apart
def remember(joint: OneJoint) -> None:
    """Move bristles and hysteresis on along the motion of the substep."""
    p, setup, work = joint.p, joint.setup, joint.work
    for body in range(3):
        g = setup.groups[body]
        if g >= 0 and work[BODY + body, LAW] == BRISTLES:
            v = (work[FREE, g] - work[X, g]) / setup.h
            side = 1.0 if v >= 0.0 else -1.0
            _, _, z = own_bristles(joint, body, v, side)
            joint.memory[BRISTLE + body] = z
    if work[SPRING_ON, BAR] == 1.0 and p.tau_h > 0.0:
        one, other = setup.groups[BAR], setup.groups[BAR + 1]
        if other < 0:
            other = setup.size
        start = work[X, one] - work[X, other]
        rate = (work[FREE, one] - work[FREE, other] - start) / setup.h
        added_torque(p, joint.memory, setup, BAR, start, rate, True)
