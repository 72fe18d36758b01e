"""Forces that depend on the motion over a substep, found together with it.

Friction, the voltage limit of a drive without inductance, gravity, contact and what springs add
to their linear models act at the mean velocity over the substep, v = (z(h) - z(0)) / h:

    v + W R(v) = v_free,      W = B_z / h,

where v_free is the mean velocity without them and W, symmetric and positive definite, is the
mean velocity that a unit of constant torque adds. The work of such a force over the substep
is then exactly -h R(v) v: never positive for friction, whatever the length of the substep, and
minus the change of the potential for a discrete gradient. With sharp friction (dq_0 = 0) a
coordinate that settles at v = 0 keeps its position exactly and comes to rest.
"""

from __future__ import annotations

import math

from cjt_gym.joint.kernel.arrays import (
    ACTIVE,
    FREE_SPEED,
    GUESS,
    JACOBIAN,
    MODE,
    RESIST,
    REST,
    SLOPE,
    SPEED,
    SPRING,
    SPRING_ON,
    SPRING_SLOPE,
    Floats,
    OneJoint,
    X,
)
from cjt_gym.joint.kernel.compiled import apart, inlined, lean
from cjt_gym.joint.kernel.resistance import (
    FREELY,
    PLAINLY,
    deflection,
    dry_sum,
    mobility,
    plain_resistance,
    resistance,
)
from cjt_gym.joint.kernel.springs import added_torque

SWEEPS = 30  # over the coordinates; where they do not settle, the substep is halved
NEWTON = 20  # steps before one coordinate after the other is solved for
HELD, SMOOTH = 0.0, 2.0  # modes of a coordinate; else the direction in which it slides
ITERATIONS = 100  # more than halvings of a bracket down to rounding
STEEPEST = 1e-3  # least slope of the equations that Newton's method is trusted with
TINIEST_PIVOT = 1e-12  # of the Jacobian
FASTEST = 1e6  # change of speed beyond which Newton's method has gone astray [rad/s]
SOLVED = 1e-9  # change of speed in the last sweep [rad/s]


@lean
def settle(
    joint: OneJoint, g: int, command: float, w: float, target: float
) -> tuple[float, float, bool]:
    """Solve v + w R(v) = target for one coordinate.

    Newton's method from the side of rest, where R is concave in speed, so that it approaches
    the root from one side; elsewhere a bracket guards it, which is halved where a step did not
    halve the error.

    Returns:
        The mean velocity v [rad/s], R(v) [N m], and whether it was found; v is exactly zero where
        the resistance holds the coordinate.
    """
    up, _ = resistance(joint, g, command, 0.0, 1.0)
    down, _ = resistance(joint, g, command, 0.0, -1.0)
    if w * down <= target <= w * up:
        return 0.0, target / w, True
    side = 1.0 if target > w * up else -1.0
    v = side * max(0.0, side * target - w * dry_sum(joint, g, side))
    low, high, error = 0.0, math.inf, math.inf
    for _ in range(ITERATIONS):
        torque, slope = resistance(joint, g, command, v, side)
        rest = v + w * torque - target
        if rest * side < 0.0:
            low = abs(v)
        else:
            high = abs(v)
        step = rest / (1.0 + w * slope) if 1.0 + w * slope > STEEPEST else math.nan
        new = v - step
        if not low < new * side < high or abs(rest) > 0.5 * error:
            new = side * 0.5 * (low + min(high, 2.0 * low + abs(rest)))
        change, v, error = abs(new - v), new, abs(rest)
        if change <= 1e-14 * (abs(v) + abs(target)):
            return v, (target - v) / w, True
    return v, (target - v) / w, False


@lean
def stretch(
    joint: OneJoint, which: int, start: float, w: float, target: float
) -> tuple[float, float, bool]:
    """Solve u + w T(u) = target for the rate u of one spring and its added torque T.

    Newton's method; T of a spring that yields flattens on both sides, between which it would jump
    to and fro: where a step did not halve the error, the bracket is halved.

    Returns:
        The rate u [rad/s], T(u) [N m], and whether it was found.
    """
    p, memory, setup = joint.p, joint.memory, joint.setup
    u = target
    low, high, error = -math.inf, math.inf, math.inf
    for _ in range(ITERATIONS):
        torque, slope = added_torque(p, memory, setup, which, start, u, False)
        rest = u + w * torque - target
        if rest < 0.0:
            low = max(low, u)
        else:
            high = min(high, u)
        step = rest / (1.0 + w * slope) if 1.0 + w * slope > STEEPEST else rest
        new = u - step
        if not low < new < high or abs(rest) > 0.5 * error:
            open_ended = math.isinf(low) or math.isinf(high)
            new = u - 2.0 * rest if open_ended else 0.5 * (low + high)
        change, u, error = abs(new - u), new, abs(rest)
        if change <= 1e-14 * (abs(u) + abs(target)):
            return u, (target - u) / w, True
    return u, (target - u) / w, False


@lean
def eliminate(work: Floats, n: int) -> bool:
    """Solve the Jacobian's equations for the residuals, in place in both.

    The Jacobian is the identity plus a positive definite matrix times slopes that hardly ever
    outweigh it, so that no pivoting is needed; return whether that holds.
    """
    for k in range(n):
        if not abs(work[JACOBIAN + k, k]) > TINIEST_PIVOT:
            return False
        for i in range(k + 1, n):
            factor = work[JACOBIAN + i, k] / work[JACOBIAN + k, k]
            for j in range(k + 1, n):
                work[JACOBIAN + i, j] -= factor * work[JACOBIAN + k, j]
            work[REST, i] -= factor * work[REST, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            work[REST, k] -= work[JACOBIAN + k, j] * work[REST, j]
        work[REST, k] /= work[JACOBIAN + k, k]
    return True


@inlined
def search(joint: OneJoint, b: Floats, command: float, load: float) -> bool:
    """Try Newton's method from the mean velocities of the substep before.

    Returns:
        Whether it converged; then rows SPEED, RESIST and SPRING hold the solution.
    """
    p, memory, setup, work = joint.p, joint.memory, joint.setup, joint.work
    size = setup.size
    for g in range(size):
        work[SPEED, g] = work[GUESS, g] if work[ACTIVE, g] != FREELY else work[FREE_SPEED, g]
        work[MODE, g] = guessed_mode(joint, g)
    for _ in range(NEWTON):
        for g in range(size):
            work[REST, g] = work[SPEED, g] - work[FREE_SPEED, g]
            for other in range(size):
                work[JACOBIAN + g, other] = 1.0 if g == other else 0.0
        for other in range(size):
            if work[MODE, other] == HELD:  # the torque is unknown in place of the velocity
                for g in range(size):
                    w = b[g, 2 + other] / setup.h
                    work[REST, g] += w * work[RESIST, other]
                    work[JACOBIAN + g, other] = w
            elif work[ACTIVE, other] != FREELY:
                v = work[SPEED, other]
                side = 1.0 if v >= 0.0 else -1.0
                if work[MODE, other] != SMOOTH:
                    side = work[MODE, other]
                if work[ACTIVE, other] == PLAINLY:
                    torque, slope = plain_resistance(joint, other, v, side)
                else:
                    torque, slope = resistance(joint, other, command, v, side)
                work[RESIST, other], work[SLOPE, other] = torque, slope
                for g in range(size):
                    w = b[g, 2 + other] / setup.h
                    work[REST, g] += w * torque
                    work[JACOBIAN + g, other] += w * slope
        for which in range(2):
            if work[SPRING_ON, which] == 1.0:
                one, other = setup.groups[which], setup.groups[which + 1]
                start, rate = deflection(joint, which, load, SPEED)
                torque, slope = added_torque(p, memory, setup, which, start, rate, False)
                work[SPRING, which], work[SPRING_SLOPE, which] = torque, slope
                for g in range(size):
                    w = mobility(setup, b, g, which)
                    work[REST, g] += w * torque
                    if work[MODE, one] != HELD:
                        work[JACOBIAN + g, one] += w * slope
                    if other >= 0 and work[MODE, other] != HELD:
                        work[JACOBIAN + g, other] -= w * slope
        if not eliminate(work, size):
            return False
        largest = 0.0
        for g in range(size):
            if work[MODE, g] == HELD:
                work[RESIST, g] -= work[REST, g]
                work[REST, g] = 0.0
            work[SPEED, g] -= work[REST, g]
            if work[ACTIVE, g] != FREELY and work[MODE, g] != HELD:
                work[RESIST, g] -= work[SLOPE, g] * work[REST, g]
                largest = max(largest, abs(work[REST, g]) - 1e-9 * abs(work[SPEED, g]))
        for which in range(2):
            if work[SPRING_ON, which] == 1.0:
                one, other = setup.groups[which], setup.groups[which + 1]
                change = work[REST, one]
                if other >= 0:
                    change -= work[REST, other]
                work[SPRING, which] -= work[SPRING_SLOPE, which] * change
        if not largest < FASTEST:
            return False
        if changes_mode(joint, command):
            continue
        if largest <= 1e-10 + 1e-7 * p.dq_0:
            return True
    return False


@lean
def guessed_mode(joint: OneJoint, g: int) -> float:
    """Return whether sharp friction holds coordinate g, as in the substep before."""
    if joint.p.dq_0 > 0.0 or dry_sum(joint, g, 1.0) + dry_sum(joint, g, -1.0) == 0.0:
        return SMOOTH
    v = joint.work[SPEED, g]
    if v == 0.0:
        return HELD
    return 1.0 if v > 0.0 else -1.0


@lean
def changes_mode(joint: OneJoint, command: float) -> bool:
    """Release bodies that friction cannot hold, and hold those that would slide backwards."""
    work, changed = joint.work, False
    for g in range(joint.setup.size):
        if work[MODE, g] == SMOOTH:
            continue
        if work[MODE, g] == HELD:
            up, _ = resistance(joint, g, command, 0.0, 1.0)
            down, _ = resistance(joint, g, command, 0.0, -1.0)
            if work[RESIST, g] > up:
                work[MODE, g], changed = 1.0, True
            elif work[RESIST, g] < down:
                work[MODE, g], changed = -1.0, True
        elif work[SPEED, g] * work[MODE, g] < 0.0:
            work[MODE, g], work[SPEED, g], changed = HELD, 0.0, True
    return changed


@apart
def descend(joint: OneJoint, b: Floats, command: float, load: float) -> bool:
    """Solve for one coordinate or spring after the other; return whether that converged."""
    setup, work = joint.setup, joint.work
    work[RESIST, :] = 0.0
    work[SPRING, :] = 0.0
    change, found = 0.0, True
    for _ in range(SWEEPS):
        change, found = 0.0, True
        for g in range(setup.size):
            if work[ACTIVE, g] == FREELY:
                continue
            w = b[g, 2 + g] / setup.h
            target = reached(joint, b, g) + w * work[RESIST, g]
            v, torque, good = settle(joint, g, command, w, target)
            found = found and good
            change = max(change, abs(torque - work[RESIST, g]) * w - 1e-13 * abs(target))
            work[SPEED, g], work[RESIST, g] = v, torque
        for which in range(2):
            if work[SPRING_ON, which] == 0.0:
                continue
            one, other = setup.groups[which], setup.groups[which + 1]
            w, target = mobility(setup, b, one, which), reached(joint, b, one)
            if other >= 0:
                w -= mobility(setup, b, other, which)
                target -= reached(joint, b, other)
                start = work[X, one] - work[X, other]
            else:
                target -= load
                start = work[X, one] - work[X, setup.size]
            target += w * work[SPRING, which]
            _, torque, good = stretch(joint, which, start, w, target)
            found = found and good
            change = max(change, abs(torque - work[SPRING, which]) * w - 1e-13 * abs(target))
            work[SPRING, which] = torque
        if change <= 1e-15:
            break
    return found and change <= SOLVED


@lean
def reached(joint: OneJoint, b: Floats, g: int) -> float:
    """Return the mean velocity of coordinate g under the torques found so far."""
    setup, work = joint.setup, joint.work
    v = work[FREE_SPEED, g]
    for other in range(setup.size):
        v -= b[g, 2 + other] / setup.h * work[RESIST, other]
    for which in range(2):
        if work[SPRING_ON, which] == 1.0:
            v -= mobility(setup, b, g, which) * work[SPRING, which]
    return float(v)


@lean
def resist(joint: OneJoint, b: Floats, command: float, load: float) -> bool:
    """Find mean velocities and resisting torques from the free ones; return whether it could."""
    found = search(joint, b, command, load) or descend(joint, b, command, load)
    for g in range(joint.setup.size):
        joint.work[GUESS, g] = joint.work[SPEED, g]
    return found
