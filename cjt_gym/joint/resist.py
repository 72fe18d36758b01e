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
from typing import Any

from cjt_gym.joint.arrays import (
    ACTIVE,
    BODY,
    BRISTLE,
    FREE,
    FREE_SPEED,
    GUESS,
    JACOBIAN,
    K_M,
    LAW,
    MESH,
    MODE,
    R_W,
    RESIST,
    REST,
    SLOPE,
    SPEED,
    SPRING,
    SPRING_ON,
    SPRING_SLOPE,
    Floats,
    Setup,
    X,
)
from cjt_gym.joint.compiled import lean
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

SWEEPS = 30
NEWTON = 20
HELD, SMOOTH = 0.0, 2.0  # modes of a coordinate; else the direction in which it slides
ITERATIONS = 60
STEEPEST = 1e-3  # least slope of the equations that Newton's method is trusted with
TINIEST_PIVOT = 1e-12  # of the Jacobian
FASTEST = 1e6  # change of speed beyond which Newton's method has gone astray [rad/s]
SOLVED = 1e-9  # change of speed in the last sweep [rad/s]
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
    """Return what `resistance` does where Coulomb friction is all there is."""
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
    """Note what resists, and guess mean velocities and torques from the present state."""
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
def settle(
    p: Any,
    memory: Floats,
    setup: Setup,
    work: Floats,
    g: int,
    command: float,
    w: float,
    target: float,
) -> tuple[float, float]:
    """Solve v + w R(v) = target for one coordinate.

    Newton's method from the side of rest, where R is concave in speed, so that it approaches
    the root from one side; a bracket guards the kinks.

    Returns:
        The mean velocity v [rad/s] and R(v) [N m]; v is exactly zero where the resistance
        holds the coordinate.
    """
    up, _ = resistance(p, memory, setup, work, g, command, 0.0, 1.0)
    down, _ = resistance(p, memory, setup, work, g, command, 0.0, -1.0)
    if w * down <= target <= w * up:
        return 0.0, target / w
    side = 1.0 if target > w * up else -1.0
    v = side * max(0.0, side * target - w * dry_sum(p, memory, work, setup.groups, g, side))
    low, high = 0.0, math.inf
    torque = 0.0
    for _ in range(ITERATIONS):
        torque, slope = resistance(p, memory, setup, work, g, command, v, side)
        rest = v + w * torque - target
        if rest * side < 0.0:
            low = abs(v)
        else:
            high = abs(v)
        step = rest / (1.0 + w * slope) if 1.0 + w * slope > STEEPEST else math.nan
        new = v - step
        if not low < new * side < high:
            new = side * 0.5 * (low + min(high, 2.0 * low + abs(rest)))
        if abs(new - v) <= 1e-14 * (abs(new) + abs(target)):
            v = new
            break
        v = new
    return v, (target - v) / w


@lean
def stretch(
    p: Any, memory: Floats, setup: Setup, which: int, start: float, w: float, target: float
) -> tuple[float, float]:
    """Solve u + w T(u) = target for the rate u of one spring and its added torque T."""
    u = target
    low, high = -math.inf, math.inf
    torque = 0.0
    for _ in range(ITERATIONS):
        torque, slope = added_torque(p, memory, setup.groups, which, start, u, setup.h, False)
        rest = u + w * torque - target
        if rest < 0.0:
            low = max(low, u)
        else:
            high = min(high, u)
        step = rest / (1.0 + w * slope) if 1.0 + w * slope > STEEPEST else rest
        new = u - step
        if not low < new < high:
            open_ended = math.isinf(low) or math.isinf(high)
            new = u - 2.0 * rest if open_ended else 0.5 * (low + high)
        if abs(new - u) <= 1e-14 * (abs(new) + abs(target)):
            u = new
            break
        u = new
    return u, (target - u) / w


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


@lean
def search(
    p: Any, memory: Floats, setup: Setup, b: Floats, command: float, load: float, work: Floats
) -> bool:
    """Try Newton's method from the mean velocities of the substep before.

    Returns:
        Whether it converged; then rows SPEED, RESIST and SPRING hold the solution.
    """
    size = setup.size
    for g in range(size):
        work[SPEED, g] = work[GUESS, g] if work[ACTIVE, g] != FREELY else work[FREE_SPEED, g]
        work[MODE, g] = guessed_mode(p, memory, setup, work, g)
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
                    torque, slope = plain_resistance(p, setup, work, other, v, side)
                else:
                    torque, slope = resistance(p, memory, setup, work, other, command, v, side)
                work[RESIST, other], work[SLOPE, other] = torque, slope
                for g in range(size):
                    w = b[g, 2 + other] / setup.h
                    work[REST, g] += w * torque
                    work[JACOBIAN + g, other] += w * slope
        for which in range(2):
            if work[SPRING_ON, which] == 1.0:
                one, other = setup.groups[which], setup.groups[which + 1]
                start, rate = deflection(setup, which, load, work, SPEED)
                torque, slope = added_torque(
                    p, memory, setup.groups, which, start, rate, setup.h, False
                )
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
        if changes_mode(p, memory, setup, work, command):
            continue
        if largest <= 1e-10 + 1e-7 * p.dq_0:
            return True
    return False


@lean
def guessed_mode(p: Any, memory: Floats, setup: Setup, work: Floats, g: int) -> float:
    """Return whether sharp friction holds coordinate g, as in the substep before."""
    if (
        p.dq_0 > 0.0
        or dry_sum(p, memory, work, setup.groups, g, 1.0)
        + dry_sum(p, memory, work, setup.groups, g, -1.0)
        == 0.0
    ):
        return SMOOTH
    v = work[SPEED, g]
    if v == 0.0:
        return HELD
    return 1.0 if v > 0.0 else -1.0


@lean
def changes_mode(p: Any, memory: Floats, setup: Setup, work: Floats, command: float) -> bool:
    """Let go what needs more torque than friction has, and hold what would slide backwards."""
    changed = False
    for g in range(setup.size):
        if work[MODE, g] == SMOOTH:
            continue
        if work[MODE, g] == HELD:
            up, _ = resistance(p, memory, setup, work, g, command, 0.0, 1.0)
            down, _ = resistance(p, memory, setup, work, g, command, 0.0, -1.0)
            if work[RESIST, g] > up:
                work[MODE, g], changed = 1.0, True
            elif work[RESIST, g] < down:
                work[MODE, g], changed = -1.0, True
        elif work[SPEED, g] * work[MODE, g] < 0.0:
            work[MODE, g], work[SPEED, g], changed = HELD, 0.0, True
    return changed


@lean
def descend(
    p: Any, memory: Floats, setup: Setup, b: Floats, command: float, load: float, work: Floats
) -> bool:
    """Solve for one coordinate or spring after the other; return whether that converged."""
    work[RESIST, :] = 0.0
    work[SPRING, :] = 0.0
    change = 0.0
    for _ in range(SWEEPS):
        change = 0.0
        for g in range(setup.size):
            if work[ACTIVE, g] == FREELY:
                continue
            w = b[g, 2 + g] / setup.h
            target = reached(setup, b, work, g) + w * work[RESIST, g]
            v, torque = settle(p, memory, setup, work, g, command, w, target)
            change = max(change, abs(torque - work[RESIST, g]) * w - 1e-13 * abs(target))
            work[SPEED, g], work[RESIST, g] = v, torque
        for which in range(2):
            if work[SPRING_ON, which] == 0.0:
                continue
            one, other = setup.groups[which], setup.groups[which + 1]
            w, target = mobility(setup, b, one, which), reached(setup, b, work, one)
            if other >= 0:
                w -= mobility(setup, b, other, which)
                target -= reached(setup, b, work, other)
                start = work[X, one] - work[X, other]
            else:
                target -= load
                start = work[X, one] - work[X, setup.size]
            target += w * work[SPRING, which]
            _, torque = stretch(p, memory, setup, which, start, w, target)
            change = max(change, abs(torque - work[SPRING, which]) * w - 1e-13 * abs(target))
            work[SPRING, which] = torque
        if change <= 1e-15:
            break
    return change <= SOLVED


@lean
def reached(setup: Setup, b: Floats, work: Floats, g: int) -> float:
    """Return the mean velocity of coordinate g under the torques found so far."""
    v = work[FREE_SPEED, g]
    for other in range(setup.size):
        v -= b[g, 2 + other] / setup.h * work[RESIST, other]
    for which in range(2):
        if work[SPRING_ON, which] == 1.0:
            v -= mobility(setup, b, g, which) * work[SPRING, which]
    return float(v)


@lean
def is_sharp(p: Any, memory: Floats, setup: Setup, work: Floats) -> bool:
    """Whether set-valued friction acts on any coordinate."""
    if p.dq_0 > 0.0:
        return False
    for body in range(3):
        if setup.groups[body] >= 0 and (
            dry_level(p, memory, work, body, 1.0) > 0.0
            or dry_level(p, memory, work, body, -1.0) > 0.0
        ):
            return True
    return False


@lean
def resist(
    p: Any, memory: Floats, setup: Setup, b: Floats, command: float, load: float, work: Floats
) -> bool:
    """Find mean velocities and resisting torques from the free ones; return whether it could."""
    found = search(p, memory, setup, b, command, load, work)
    found = found or descend(p, memory, setup, b, command, load, work)
    for g in range(setup.size):
        work[GUESS, g] = work[SPEED, g]
    return found


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
