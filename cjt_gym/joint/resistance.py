"""The forces that resist the motion of each coordinate, and the states that they leave.

Friction of the bodies, weight and contact, and the voltage limit of a drive without inductance add
up per coordinate; what springs add to their linear models acts between two.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.joint.arrays import (
    ACTIVE,
    BODY,
    BRISTLE,
    FREE,
    GUESS,
    K_M,
    LAW,
    MESH,
    R_W,
    RESIST,
    SPEED,
    SPRING,
    SPRING_ON,
    Floats,
    Setup,
    X,
)
from cjt_gym.joint.compiled import apart, lean
from cjt_gym.joint.drives import STATIC, static_current
from cjt_gym.joint.friction import (
    BRISTLES,
    COULOMB,
    LOAD,
    NONE,
    bristles,
    coulomb_friction,
    dry_level,
    friction,
    note_friction,
)
from cjt_gym.joint.load_forces import has_load_force, load_force
from cjt_gym.joint.springs import BAR, added_torque, is_nonlinear

FREELY, PLAINLY, ANY = 0.0, 1.0, 2.0  # what resists a coordinate


@lean
def resistance(
    p: Any,
    memory: Floats,
    setup: Setup,
    work: Floats,
    g: int,
    command: float,
    v: float,
    side: float,
) -> tuple[float, float]:
    """Return the resisting torque on coordinate g at mean velocity v, and its slope."""
    torque, slope = 0.0, 0.0
    for body in range(3):
        if setup.groups[body] == g and work[BODY + body, LAW] != NONE:
            t, s = friction(p, memory, work, body, v, side, setup.h)
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


@lean
def plain_resistance(
    p: Any, setup: Setup, work: Floats, g: int, v: float, side: float
) -> tuple[float, float]:
    """Return what `resistance` does if there is only Coulomb friction."""
    torque, slope = 0.0, 0.0
    for body in range(3):
        if setup.groups[body] == g:
            t, s = coulomb_friction(p.dq_0, work, BODY + body, v, side)
            torque += t
            slope += s
    return torque, slope


@lean
def kind_of_resistance(p: Any, setup: Setup, work: Floats, g: int) -> float:
    """Return whether nothing, Coulomb friction alone, or anything resists coordinate g."""
    if setup.groups[LOAD] == g and has_load_force(p):
        return ANY
    if setup.drive == STATIC and setup.groups[0] == g:
        return ANY
    kind = FREELY
    for body in range(3):
        if setup.groups[body] == g:
            law = work[BODY + body, LAW]
            if law > COULOMB:
                return ANY
            if law == COULOMB:
                kind = PLAINLY
    return kind


@lean
def prepare(
    p: Any, memory: Floats, setup: Setup, command: float, load: float, work: Floats
) -> None:
    """Determine what resists, and guess mean velocities and torques from the present state."""
    note_friction(p, work)
    for g in range(setup.size):
        work[ACTIVE, g] = kind_of_resistance(p, setup, work, g)
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
            start, rate = deflection(setup, which, load, work, GUESS)
            added, _ = added_torque(p, memory, setup.groups, which, start, rate, setup.h, False)
            work[SPRING, which] = added
    for g in range(setup.size):
        if work[ACTIVE, g] != FREELY:
            v = work[GUESS, g]
            up, down = 1.0 if v >= 0.0 else -1.0, 1.0 if v > 0.0 else -1.0
            ahead, _ = resistance(p, memory, setup, work, g, command, v, up)
            back, _ = resistance(p, memory, setup, work, g, command, v, down)
            work[RESIST, g] = 0.5 * (ahead + back)  # at rest neither direction is preferred
        else:
            work[RESIST, g] = 0.0


@lean
def deflection(
    setup: Setup, which: int, load: float, work: Floats, row: int
) -> tuple[float, float]:
    """Return a spring's deflection at the start and its mean rate, from the speeds in a row."""
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


@lean
def dry_sum(
    p: Any, memory: Floats, work: Floats, groups: tuple[int, int, int], g: int, side: float
) -> float:
    """Return the set-valued friction that can hold coordinate g [N m]."""
    total = 0.0
    for body in range(3):
        if groups[body] == g:
            total += dry_level(p, memory, work, body, side)
    return total


@lean
def shift(b: Floats, setup: Setup, sign: float, work: Floats) -> None:
    """Add the effect of the torques in rows RESIST and SPRING to the end of the substep."""
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
def come_to_rest(p: Any, memory: Floats, setup: Setup, b: Floats, work: Floats) -> None:
    """Hold the coordinates that sharp friction has stopped: exact position, no velocity.

    A coordinate is held if it did not move in the mean, or if it turned within the substep
    although friction could have held it. Both only take kinetic energy away.
    """
    for g in range(setup.size):
        up = dry_sum(p, memory, work, setup.groups, g, 1.0)
        down = dry_sum(p, memory, work, setup.groups, g, -1.0)
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
def remember(p: Any, memory: Floats, setup: Setup, work: Floats) -> None:
    """Move bristles and hysteresis on along the motion of the substep."""
    for body in range(3):
        g = setup.groups[body]
        if g >= 0 and work[BODY + body, LAW] == BRISTLES:
            v = (work[FREE, g] - work[X, g]) / setup.h
            side = 1.0 if v >= 0.0 else -1.0
            z = memory[BRISTLE + body]
            _, _, z = bristles(p, work, body, z, v, side, memory[MESH], setup.h)
            memory[BRISTLE + body] = z
    if work[SPRING_ON, BAR] == 1.0 and p.tau_h > 0.0:
        one, other = setup.groups[BAR], setup.groups[BAR + 1]
        if other < 0:
            other = setup.size
        start = work[X, one] - work[X, other]
        rate = (work[FREE, one] - work[FREE, other] - start) / setup.h
        added_torque(p, memory, setup.groups, BAR, start, rate, setup.h, True)
