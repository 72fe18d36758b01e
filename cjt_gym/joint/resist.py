"""Forces that resist motion, taken at the mean velocity over a substep.

Friction and the voltage limit of a drive without inductance act at the mean velocity over the
substep, v = (z(h) - z(0)) / h:

    v + W R(v) = v_free,      W = B_z / h,

where v_free is the mean velocity without them and W, symmetric and positive definite, is the
mean velocity that a unit of constant torque adds. The work of such a force over the substep
is then exactly -h R(v) v <= 0, so that no substep creates energy, whatever its length. The
equation is the optimality condition of a convex function. With sharp friction (dq_0 = 0) a
coordinate that settles at v = 0 keeps its position exactly and comes to rest.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.arrays import (
    ACTIVE,
    FREE,
    FREE_SPEED,
    GUESS,
    JACOBIAN,
    RESIST,
    REST,
    SLOPE,
    SPEED,
    Floats,
    Setup,
    X,
)
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.drives import STATIC, static_current
from cjt_gym.joint.friction import coulomb_levels, friction, has_friction

SWEEPS = 100
NEWTON = 12
ITERATIONS = 60


@compiled
def resistance(
    p: Any, setup: Setup, g: int, command: float, v: float, side: float
) -> tuple[float, float]:
    """Return the resisting torque on coordinate g at mean velocity v, and its slope."""
    torque, slope = 0.0, 0.0
    for body in range(3):
        if setup.groups[body] == g:
            t, s = friction(p, body, v, side)
            torque += t
            slope += s
    if setup.drive == STATIC and setup.groups[0] == g:
        k = p.k_t * p.n
        current, s = static_current(p, command, setup.is_voltage, v)
        torque -= k * current
        slope -= k * s
    return torque, slope


@compiled
def resists(p: Any, setup: Setup, g: int) -> bool:
    """Whether anything resists the motion of coordinate g."""
    for body in range(3):
        if setup.groups[body] == g and has_friction(p, body):
            return True
    return bool(setup.drive == STATIC and setup.groups[0] == g)


@compiled
def coulomb_sum(p: Any, groups: tuple[int, int, int], g: int, side: float) -> float:
    """Return the Coulomb level of coordinate g in the direction of `side` [N m]."""
    total = 0.0
    for body in range(3):
        if groups[body] == g:
            up, down = coulomb_levels(p, body)
            total += up if side > 0.0 else down
    return total


@compiled
def settle(
    p: Any, setup: Setup, g: int, command: float, w: float, target: float
) -> tuple[float, float]:
    """Solve v + w R(v) = target for one coordinate.

    Newton's method from the side of rest, where R is concave in speed, so that it approaches
    the root from one side; a bracket guards the kinks.

    Returns:
        The mean velocity v [rad/s] and R(v) [N m]; v is exactly zero where the resistance
        holds the coordinate.
    """
    up, _ = resistance(p, setup, g, command, 0.0, 1.0)
    down, _ = resistance(p, setup, g, command, 0.0, -1.0)
    if w * down <= target <= w * up:
        return 0.0, target / w
    side = 1.0 if target > w * up else -1.0
    v = side * max(0.0, side * target - w * coulomb_sum(p, setup.groups, g, side))
    low, high = 0.0, math.inf
    torque = 0.0
    for _ in range(ITERATIONS):
        torque, slope = resistance(p, setup, g, command, v, side)
        rest = v + w * torque - target
        if rest * side < 0.0:
            low = abs(v)
        else:
            high = abs(v)
        step = rest / (1.0 + w * slope)
        new = v - step
        if not low <= new * side <= high:
            new = side * 0.5 * (low + min(high, 2.0 * low + abs(step)))
        if abs(new - v) <= 1e-14 * (abs(new) + abs(target)):
            v = new
            break
        v = new
    return v, (target - v) / w


@compiled
def eliminate(work: Floats, n: int) -> None:
    """Solve the Jacobian's equations for the residuals, in place in both.

    The Jacobian is the identity plus a positive definite matrix times non-negative slopes, so
    that no pivoting is needed.
    """
    for k in range(n):
        for i in range(k + 1, n):
            factor = work[JACOBIAN + i, k] / work[JACOBIAN + k, k]
            for j in range(k + 1, n):
                work[JACOBIAN + i, j] -= factor * work[JACOBIAN + k, j]
            work[REST, i] -= factor * work[REST, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            work[REST, k] -= work[JACOBIAN + k, j] * work[REST, j]
        work[REST, k] /= work[JACOBIAN + k, k]


@compiled
def search(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> bool:
    """Try Newton's method from the mean velocities of the substep before.

    Returns:
        Whether it converged; then rows SPEED and RESIST hold the solution.
    """
    size = setup.size
    for g in range(size):
        work[SPEED, g] = work[GUESS, g] if work[ACTIVE, g] == 1.0 else work[FREE_SPEED, g]
    for _ in range(NEWTON):
        for g in range(size):
            work[REST, g] = work[SPEED, g] - work[FREE_SPEED, g]
            for other in range(size):
                work[JACOBIAN + g, other] = 1.0 if g == other else 0.0
        for other in range(size):
            if work[ACTIVE, other] == 1.0:
                v = work[SPEED, other]
                side = 1.0 if v >= 0.0 else -1.0
                torque, slope = resistance(p, setup, other, command, v, side)
                work[RESIST, other], work[SLOPE, other] = torque, slope
                for g in range(size):
                    w = b[g, 2 + other] / setup.h
                    work[REST, g] += w * torque
                    work[JACOBIAN + g, other] += w * slope
        eliminate(work, size)
        largest = 0.0
        for g in range(size):
            work[SPEED, g] -= work[REST, g]
            if work[ACTIVE, g] == 1.0:
                work[RESIST, g] -= work[SLOPE, g] * work[REST, g]
                largest = max(largest, abs(work[REST, g]) - 1e-9 * abs(work[SPEED, g]))
        if largest <= 1e-7 * p.dq_0:
            return True
    return False


@compiled
def descend(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> None:
    """Minimise one coordinate after the other; it converges whatever the coupling."""
    work[RESIST, :] = 0.0
    for _ in range(SWEEPS):
        change = 0.0
        for g in range(setup.size):
            if work[ACTIVE, g] == 0.0:
                continue
            target, w = work[FREE_SPEED, g], b[g, 2 + g] / setup.h
            for other in range(setup.size):
                if other != g:
                    target -= b[g, 2 + other] / setup.h * work[RESIST, other]
            v, torque = settle(p, setup, g, command, w, target)
            change = max(change, abs(torque - work[RESIST, g]) * w - 1e-13 * abs(target))
            work[SPEED, g], work[RESIST, g] = v, torque
        if change <= 1e-15:
            break


@compiled
def resist(p: Any, setup: Setup, b: Floats, command: float, work: Floats) -> bool:
    """Find mean velocities and resisting torques from the free ones; False if none resists."""
    active = 0.0
    for g in range(setup.size):
        active += work[ACTIVE, g]
    if active == 0.0:
        return False
    if p.dq_0 == 0.0 or not search(p, setup, b, command, work):
        descend(p, setup, b, command, work)
    for g in range(setup.size):
        work[GUESS, g] = work[SPEED, g]
    return True


@compiled
def come_to_rest(p: Any, setup: Setup, b: Floats, work: Floats) -> None:
    """Hold the coordinates that sharp friction has stopped: exact position, no velocity.

    A coordinate is held if it did not move in the mean, or if it turned within the substep
    although friction could have held it. Both only take kinetic energy away.
    """
    for g in range(setup.size):
        up = coulomb_sum(p, setup.groups, g, 1.0)
        down = coulomb_sum(p, setup.groups, g, -1.0)
        if up + down == 0.0:
            continue
        row = setup.order - setup.size + g
        if work[SPEED, g] == 0.0:
            work[FREE, g], work[FREE, row] = work[X, g], 0.0
        elif work[FREE, row] * work[SPEED, g] < 0.0:
            needed = (work[FREE, row] - work[X, row]) / b[row, 2 + g] + work[RESIST, g]
            if -down <= needed <= up:
                work[FREE, row] = 0.0


@compiled
def shift(b: Floats, setup: Setup, sign: float, work: Floats) -> None:
    """Add the effect of the resisting torques in row RESIST to the end of the substep."""
    for g in range(setup.size):
        if work[ACTIVE, g] == 1.0:
            for i in range(setup.order):
                work[FREE, i] += sign * b[i, 2 + g] * work[RESIST, g]
