"""Many joints side by side: the substeps of the most common joints, in vector registers.

The same equations and the same scheme as `substep`, for joints with linear springs, with Coulomb
and one-sided viscous friction (smooth or sharp), a breakaway above it, cogging and a weight at the
load, driven by a current source with or without a lag, or by a voltage without inductance. The
back-EMF of the latter is viscous friction. A weight hardly changes within a substep: it is found by
repetition. A breakaway may fall so steeply that a substep has several solutions; such joints are
not for these lanes (`UNIQUE`).
WIDTH joints form a block: each of its rows holds one quantity, a number per joint; `p` are its
parameters and `s` is scratch. The code reads as if for a single joint; where joints take different
branches, `choose` computes both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import inlined, lean
from cjt_gym.joint.kernel.load_forces import TINY
from cjt_gym.joint.lanes.vector_math import decay, sine_cosine
from cjt_gym.joint.lanes.vectors import (
    choose,
    get,
    madd,
    put,
    somewhere,
)

NEWTON = 20  # as in `implicit_solver`
SWEEPS = 60  # the same with sharp friction, which may change sides in between
UNIQUE = 0.95  # bound on the steepest fall of friction over the inertia's h / I, for one solution
STEEPEST_FALL = 0.8577638849607068  # of exp(-x^2), at x = sqrt(1/2)
SHARP_SOLVED = 1e-15  # change of speed in the last sweep, relative to the largest so far

# Rows of the parameters `p` of a block:
A = 0  # system matrix, six rows of six
MOTOR = 36  # what motor torque, load input and friction on each coordinate add to the states
LOAD = 42
RUB = 48  # three columns of six
MOBILITY = 66  # mean velocity of coordinate k per torque on coordinate m, three rows of three
UP = 75  # levels of friction in both directions, and viscous friction in the negative one
DOWN = 78
EXTRA = 81
STEEP = 84  # 1 / dq_0
ENOUGH, CLOSE = 85, 86  # steps of Newton's method after which a speed is solved
PEAK, OFFSET, K_B, D_GL = 87, 88, 89, 90
LATE, LATE_SUB = 91, 92  # control steps and substeps after which a command acts
PLAIN, USABLE = 93, 94  # whether sensors are ideal, and whether this code can move the joint
RESOLUTION, PER_UNIT = 95, 96  # step of the command, and motor torque per unit of it
STAYS, MEAN = 97, 98  # share of a change of current that a lag leaves after a substep, and its mean
PER_VOLT, SLOWED = 99, 100  # current per voltage [A/V], and what a speed takes from it [A s/rad]
FORE = 101  # viscous friction in the positive direction: that of a back-EMF
LIMIT = 104  # largest current of a voltage drive [A]
WEIGHT, HANGS = 105, 106  # largest torque of a weight, and the angle at which it has none
EXCESS, PER_V_S = 107, 110  # breakaway above the levels, and 1 / v_s
TONES = 111  # three rows per harmonic: frequency, cosine, sine
# Rows of the scratch `s` of a thread:
X = 0  # states
COMMAND, CURRENT, BEFORE, AFTER, PUSHED = range(6, 11)
# The command, the current of a voltage, what acts before and after a command does, the load input.
PUSH = 11  # what motor torque and load input add to the states
FREE = 17  # states at the end of a substep
RIPPLE = 23  # ripple torque of the substep before
SPEED = 24  # mean velocities of the coordinates with friction
WANTED = 27  # the same without friction
DRAG = 30  # friction torques
FAILED = 33  # whether the joint is left to the general kernel
SINE, COSINE = 34, 35  # of its rotor, for the environment
BEFORE_DRAG = 36  # friction torques of the substep before the last
LAGGED = 39  # current behind a lag
ACTING = 40  # the current or voltage that acts, within its limit
PULL = 41  # mean torque of the weight
SCRATCH_ROWS = 42


class Kind(NamedTuple):
    """What the joints of a batch have in common."""

    order: int  # number of mechanical states
    velocity: int  # where velocities begin among them
    n: int  # number of coordinates with friction
    first: int  # the coordinates with friction
    second: int  # the second of them
    third: int  # the third of them
    sharp: int  # 1 where the sign of the velocity is sharp (dq_0 = 0), else 0
    tones: int  # number of cogging harmonics
    lags: int  # 1 where a lag precedes the current, else 0
    volts: int  # 1 where the command is a voltage, else 0
    falls: int  # 1 where friction falls from a breakaway, else 0
    weighs: int  # 1 + the number of the load's coordinate where a weight hangs there, else 0


@inlined
def coordinate(kind: Kind, k: int) -> int:
    """Return which coordinate is number k of those with friction."""
    return kind.first if k == 0 else (kind.second if k == 1 else kind.third)


@inlined
def breakaway(p: Floats, k: int, v: Any) -> tuple[Any, Any]:
    """Return what a breakaway adds to the level of friction at velocity v, and its slope."""
    ratio = v * get(p, PER_V_S)
    bump = get(p, EXCESS + k) * decay(0.5 * ratio * ratio)
    return bump, -2.0 * bump * ratio * get(p, PER_V_S)


@inlined
def friction(kind: Kind, p: Floats, k: int, v: Any) -> tuple[Any, Any]:
    """Return the smooth friction on coordinate k at velocity v, and its slope.

    With e = exp(-2 |v| / dq_0), tanh is (1 - e) / (1 + e) of its sign, its slope 4 e / (1 + e)^2.
    """
    ahead, steep = v >= 0.0, get(p, STEEP)
    level = choose(ahead, get(p, UP + k), get(p, DOWN + k))
    extra = choose(ahead, get(p, FORE + k), get(p, EXTRA + k))
    e = decay(v * steep)
    a = 1.0 + e
    per_a = 1.0 / a
    signed = choose(ahead, 1.0 - e, e - 1.0)
    if kind.falls:
        bump, falling = breakaway(p, k, v)
        level = level + bump
        extra_slope = madd(falling * signed, per_a, extra)
    else:
        extra_slope = extra
    slope = madd(4.0 * steep * level, e, extra_slope * (a * a))
    return madd(level * signed, per_a, extra * v), slope * (per_a * per_a)


@inlined
def weight(kind: Kind, p: Floats, s: Floats, v: Any, h: float) -> Any:
    """Return the mean torque of the weight over a substep at mean speed v, as `mean_gravity`."""
    start = get(s, X + coordinate(kind, kind.weighs - 1))
    half = 0.5 * h * v
    sine, _ = sine_cosine(half)
    moves = abs(half) > TINY
    spread = choose(moves, sine / choose(moves, half, 1.0), 1.0)
    level, _ = sine_cosine(start + half - get(p, HANGS))
    return get(p, WEIGHT) * level * spread


@lean
def predict(kind: Kind, p: Floats, s: Floats, h: float) -> None:
    """Take friction and weight at the present speed, and no ripple."""
    put(s, RIPPLE, 0.0)
    if kind.weighs > 0:
        v = get(s, X + kind.velocity + coordinate(kind, kind.weighs - 1))
        put(s, PULL, weight(kind, p, s, v, h))
    for k in range(kind.n):
        v = get(s, X + kind.velocity + coordinate(kind, k))
        if kind.sharp:
            up, down = get(p, UP + k), get(p, DOWN + k)
            if kind.falls:
                bump, _ = breakaway(p, k, v)
                up, down = up + bump, down + bump
            behind = get(p, EXTRA + k) * v - down
            held, before = 0.5 * (up - down), get(p, FORE + k) * v + up
            put(s, DRAG + k, choose(v > 0.0, before, choose(v < 0.0, behind, held)))
        else:
            torque, _ = friction(kind, p, k, v)
            put(s, DRAG + k, torque)
            put(s, BEFORE_DRAG + k, torque)


@lean
def push(kind: Kind, p: Floats, s: Floats, step: int) -> None:
    """Note what the motor torque of a substep and the load input add to the states."""
    wanted = choose(get(p, LATE_SUB) <= float(step), get(s, AFTER), get(s, BEFORE))
    if kind.lags:
        gap = get(s, LAGGED) - wanted
        put(s, LAGGED, madd(get(p, STAYS), gap, wanted))
        wanted = madd(get(p, MEAN), gap, wanted)
    peak = get(p, PEAK)
    acting = choose(wanted > peak, peak, choose(wanted < 0.0 - peak, 0.0 - peak, wanted))
    put(s, ACTING, acting)
    torque, load = madd(get(p, PER_UNIT), acting, get(p, OFFSET)), get(s, PUSHED)
    for i in range(kind.order):
        put(s, PUSH + i, madd(get(p, MOTOR + i), torque, get(p, LOAD + i) * load))


@lean
def move(kind: Kind, p: Floats, s: Floats) -> None:
    """Advance the linear joint; three states at once, those that do not exist stay zero."""
    for i in range(0, kind.order, 3):
        first, second, third = get(s, PUSH + i), get(s, PUSH + i + 1), get(s, PUSH + i + 2)
        for j in range(0, kind.order, 3):
            x, y, z = get(s, X + j), get(s, X + j + 1), get(s, X + j + 2)
            a = A + 6 * i + j
            first = madd(get(p, a), x, madd(get(p, a + 1), y, madd(get(p, a + 2), z, first)))
            a += 6
            second = madd(get(p, a), x, madd(get(p, a + 1), y, madd(get(p, a + 2), z, second)))
            a += 6
            third = madd(get(p, a), x, madd(get(p, a + 1), y, madd(get(p, a + 2), z, third)))
        put(s, FREE + i, first)
        put(s, FREE + i + 1, second)
        put(s, FREE + i + 2, third)


@lean
def cog(kind: Kind, p: Floats, s: Floats, h: float) -> None:
    """Find the ripple in the middle of the motion that the last friction and ripple give."""
    speed = kind.velocity
    ripple = get(s, RIPPLE)
    q = madd(get(p, MOTOR), ripple, get(s, FREE))
    dq = madd(get(p, MOTOR + speed), ripple, get(s, FREE + speed))
    for k in range(kind.n):
        drag = get(s, DRAG + k)
        q = q - get(p, RUB + 6 * k) * drag
        dq = dq - get(p, RUB + 6 * k + speed) * drag
    if kind.weighs > 0:
        q = q - get(p, RUB + 6 * (kind.weighs - 1)) * get(s, PULL)
        dq = dq - get(p, RUB + 6 * (kind.weighs - 1) + speed) * get(s, PULL)
    q = 0.5 * (get(s, X) + q) + 0.125 * h * (get(s, X + speed) - dq)
    total = 0.0 * q
    for j in range(kind.tones):
        row = TONES + 3 * j
        sine, cosine = sine_cosine(get(p, row) * q)
        total = madd(get(p, row + 1), cosine, madd(get(p, row + 2), sine, total))
    put(s, RIPPLE, total)


@lean
def aim(kind: Kind, p: Floats, s: Floats, h: float) -> None:
    """Note the mean speeds without friction, and those under the friction to be expected.

    That is what the last substep had, and where it is smooth, as much more as it grew by then.
    """
    ripple, per_h = get(s, RIPPLE), 1.0 / h
    for k in range(0 if kind.sharp else kind.n):
        last = get(s, DRAG + k)
        put(s, DRAG + k, 2.0 * last - get(s, BEFORE_DRAG + k))
        put(s, BEFORE_DRAG + k, last)
    for k in range(kind.n):
        g = coordinate(kind, k)
        v = (madd(get(p, MOTOR + g), ripple, get(s, FREE + g)) - get(s, X + g)) * per_h
        if kind.weighs > 0:
            v = v - get(p, MOBILITY + 3 * k + kind.weighs - 1) * get(s, PULL)
        put(s, WANTED + k, v)
        for m in range(kind.n):
            v = v - get(p, MOBILITY + 3 * k + m) * get(s, DRAG + m)
        put(s, SPEED + k, v)


@inlined
def settle(
    p: Floats, s: Floats, k: int, busy: Any, v: Any, drag: tuple[Any, Any], change: Any
) -> Any:
    """Correct the speed of coordinate k, where it is not solved; return where it is solved now.

    A step that would pass zero ends there: friction is concave in speed on either side of it, so
    that from rest the next steps approach the solution from one side, however steep friction is.
    Solved is what is within 1e-10 rad/s + 1e-7 dq_0, and what rounding leaves of the speed. The
    error that a step leaves is at most its square / dq_0 where it does not pass the kink at zero.
    """
    torque, slope = drag
    new = v - change
    new = choose(v * new < 0.0, 0.0, new)
    put(s, SPEED + k, choose(busy, new, v))
    put(s, DRAG + k, choose(busy, torque - slope * (v - new), get(s, DRAG + k)))
    step = abs(change) - 1e-9 * abs(v)
    smooth = (v * new > 0.0) & (step <= get(p, CLOSE))
    return smooth | (step <= get(p, ENOUGH))


@lean
def newton_1(kind: Kind, p: Floats, s: Floats, busy: Any) -> Any:
    """Take one step of Newton's method for one coordinate; return where it is not solved."""
    v, w = get(s, SPEED), get(p, MOBILITY)
    r, g = friction(kind, p, 0, v)
    change = (v - get(s, WANTED) + w * r) / (1.0 + w * g)
    return busy & ~settle(p, s, 0, busy, v, (r, g), change)


@lean
def newton_2(kind: Kind, p: Floats, s: Floats, busy: Any) -> Any:
    """Take one step for two coordinates."""
    v1, v2 = get(s, SPEED), get(s, SPEED + 1)
    r1, g1 = friction(kind, p, 0, v1)
    r2, g2 = friction(kind, p, 1, v2)
    w11, w12 = get(p, MOBILITY), get(p, MOBILITY + 1)
    w21, w22 = get(p, MOBILITY + 3), get(p, MOBILITY + 4)
    e1 = v1 - get(s, WANTED) + w11 * r1 + w12 * r2
    e2 = v2 - get(s, WANTED + 1) + w21 * r1 + w22 * r2
    j11, j12 = 1.0 + w11 * g1, w12 * g2
    j21, j22 = w21 * g1, 1.0 + w22 * g2
    scale = 1.0 / (j11 * j22 - j12 * j21)
    solved = settle(p, s, 0, busy, v1, (r1, g1), (j22 * e1 - j12 * e2) * scale)
    solved = solved & settle(p, s, 1, busy, v2, (r2, g2), (j11 * e2 - j21 * e1) * scale)
    return busy & ~solved


@lean
def newton_3(kind: Kind, p: Floats, s: Floats, busy: Any) -> Any:
    """Take one step for three coordinates."""
    v1, v2, v3 = get(s, SPEED), get(s, SPEED + 1), get(s, SPEED + 2)
    r1, g1 = friction(kind, p, 0, v1)
    r2, g2 = friction(kind, p, 1, v2)
    r3, g3 = friction(kind, p, 2, v3)
    w11, w12, w13 = get(p, MOBILITY), get(p, MOBILITY + 1), get(p, MOBILITY + 2)
    w21, w22, w23 = get(p, MOBILITY + 3), get(p, MOBILITY + 4), get(p, MOBILITY + 5)
    w31, w32, w33 = get(p, MOBILITY + 6), get(p, MOBILITY + 7), get(p, MOBILITY + 8)
    e1 = v1 - get(s, WANTED) + w11 * r1 + w12 * r2 + w13 * r3
    e2 = v2 - get(s, WANTED + 1) + w21 * r1 + w22 * r2 + w23 * r3
    e3 = v3 - get(s, WANTED + 2) + w31 * r1 + w32 * r2 + w33 * r3
    j11, j12, j13 = 1.0 + w11 * g1, w12 * g2, w13 * g3
    j21, j22, j23 = w21 * g1, 1.0 + w22 * g2, w23 * g3
    j31, j32, j33 = w31 * g1, w32 * g2, 1.0 + w33 * g3
    c11, c12, c13 = j22 * j33 - j23 * j32, j13 * j32 - j12 * j33, j12 * j23 - j13 * j22
    c21, c22, c23 = j23 * j31 - j21 * j33, j11 * j33 - j13 * j31, j13 * j21 - j11 * j23
    c31, c32, c33 = j21 * j32 - j22 * j31, j12 * j31 - j11 * j32, j11 * j22 - j12 * j21
    scale = 1.0 / (j11 * c11 + j12 * c21 + j13 * c31)
    solved = settle(p, s, 0, busy, v1, (r1, g1), (c11 * e1 + c12 * e2 + c13 * e3) * scale)
    second = settle(p, s, 1, busy, v2, (r2, g2), (c21 * e1 + c22 * e2 + c23 * e3) * scale)
    third = settle(p, s, 2, busy, v3, (r3, g3), (c31 * e1 + c32 * e2 + c33 * e3) * scale)
    return busy & ~(solved & (second & third))


@lean
def project(kind: Kind, p: Floats, s: Floats, busy: Any) -> Any:
    """Solve for one coordinate with sharp friction after the other; return as `newton_1` does."""
    change = 0.0 * get(p, STEEP)
    for k in range(kind.n):
        w, before = get(p, MOBILITY + 4 * k), get(s, DRAG + k)
        target = madd(w, before, get(s, WANTED + k))
        for m in range(kind.n):
            target = target - get(p, MOBILITY + 3 * k + m) * get(s, DRAG + m)
        up, down, extra = get(p, UP + k), get(p, DOWN + k), get(p, EXTRA + k)
        fore, back = 0.0 * up, extra
        starts, turns = target > w * up, target < 0.0 - w * down
        if kind.volts:
            fore = get(p, FORE + k)
        if kind.falls:  # linear around the speed of the last sweep, and level at rest
            excess = get(p, EXCESS + k)
            starts, turns = target > w * (up + excess), target < 0.0 - w * (down + excess)
            near = get(s, SPEED + k)
            near = choose((starts & (near > 0.0)) | (turns & (near < 0.0)), near, 0.0)
            bump, falling = breakaway(p, k, near)
            bump = bump - falling * near
            up, down = up + bump, down + bump
            fore, back = fore + falling, back - falling
        ahead, behind = target - w * up, target + w * down
        if kind.volts or kind.falls:
            ahead = ahead / (1.0 + w * fore)
            up = madd(fore, ahead, up)
        behind = behind / (1.0 + w * back)
        v = choose(starts, ahead, choose(turns, behind, 0.0))
        torque = choose(starts, up, choose(turns, back * v - down, target / w))
        put(s, SPEED + k, choose(busy, v, get(s, SPEED + k)))
        put(s, DRAG + k, choose(busy, torque, before))
        moved = abs(torque - before) * w - 1e-13 * abs(target)
        change = choose(moved <= change, change, moved)
    return busy & ~(change <= SHARP_SOLVED)


@lean
def hang(kind: Kind, p: Floats, s: Floats, busy: Any, h: float) -> Any:
    """Take the weight at the mean speed, where it is not solved; return where it is not settled."""
    k, before = kind.weighs - 1, get(s, PULL)
    change = choose(busy, weight(kind, p, s, get(s, SPEED + k), h) - before, 0.0)
    put(s, PULL, before + change)
    for m in range(kind.n):
        moved = get(p, MOBILITY + 3 * m + k) * change
        put(s, WANTED + m, get(s, WANTED + m) - moved)
    moved = abs(change) * get(p, MOBILITY + 4 * k)
    if kind.sharp:
        return busy & ~(moved - 1e-13 * abs(get(s, WANTED + k)) <= SHARP_SOLVED)
    return busy & ~(moved - 1e-9 * abs(get(s, SPEED + k)) <= get(p, ENOUGH))


@lean
def solve(kind: Kind, p: Floats, s: Floats, h: float) -> None:
    """Solve for friction, weight and speeds together, and note the joints for which that failed."""
    steep = get(p, STEEP)
    busy = steep == steep
    if kind.weighs > 0:
        hang(kind, p, s, busy, h)
    for _ in range(SWEEPS if kind.sharp else NEWTON):
        before = busy
        if kind.sharp:
            busy = project(kind, p, s, busy)
        elif kind.n == 1:
            busy = newton_1(kind, p, s, busy)
        elif kind.n == 2:
            busy = newton_2(kind, p, s, busy)
        else:
            busy = newton_3(kind, p, s, busy)
        if kind.weighs > 0:
            busy = busy | hang(kind, p, s, before, h)
        if not somewhere(busy):
            return
    put(s, FAILED, choose(busy, 1.0, get(s, FAILED)))


@lean
def stop(kind: Kind, p: Floats, s: Floats) -> None:
    """Bring to rest what sharp friction has stopped."""
    for k in range(kind.n):
        g = coordinate(kind, k)
        row = kind.velocity + g
        v, end = get(s, SPEED + k), get(s, FREE + row)
        up, down = get(p, UP + k), get(p, DOWN + k)
        if kind.falls:
            up, down = up + get(p, EXCESS + k), down + get(p, EXCESS + k)
        dry = choose(v > 0.0, up, 0.0 - down)
        needed = (end - get(s, X + row)) / get(p, RUB + 6 * k + row) + dry
        turned = (end * v < 0.0) & ((0.0 - down <= needed) & (needed <= up))
        rests = (v == 0.0) & (up + down != 0.0)
        put(s, FREE + g, choose(rests, get(s, X + g), get(s, FREE + g)))
        put(s, FREE + row, choose(turned | rests, 0.0, end))


@lean
def conduct(p: Floats, s: Floats) -> None:
    """Find the current that a voltage drives at the mean speed; one at its limit is not ours."""
    current = get(p, PER_VOLT) * get(s, ACTING) - get(p, SLOWED) * get(s, SPEED)
    put(s, CURRENT, current)
    put(s, FAILED, choose(abs(current) > get(p, LIMIT), 1.0, get(s, FAILED)))


@lean
def arrive(kind: Kind, p: Floats, s: Floats) -> None:
    """Add ripple, friction and weight as they were found."""
    ripple, end = get(s, RIPPLE), FREE if kind.sharp else X
    for i in range(kind.order):
        value = madd(get(p, MOTOR + i), ripple, get(s, FREE + i))
        for k in range(kind.n):
            value = value - get(p, RUB + 6 * k + i) * get(s, DRAG + k)
        if kind.weighs > 0:
            value = value - get(p, RUB + 6 * (kind.weighs - 1) + i) * get(s, PULL)
        put(s, end + i, value)
    if kind.sharp:
        stop(kind, p, s)
        for i in range(kind.order):
            put(s, X + i, get(s, FREE + i))


@lean
def run(kind: Kind, p: Floats, s: Floats, substeps: int, h: float) -> None:
    """Take the substeps of a control step, and note whose equations stay unsolved."""
    predict(kind, p, s, h)
    for step in range(substeps):
        if step == 0 or kind.lags or somewhere(get(p, LATE_SUB) == float(step)):
            push(kind, p, s, step)
        move(kind, p, s)
        if kind.tones > 0:
            if step == 0:
                cog(kind, p, s, h)
            cog(kind, p, s, h)
        aim(kind, p, s, h)
        if kind.n > 0:
            solve(kind, p, s, h)
        if kind.volts:
            conduct(p, s)
        arrive(kind, p, s)
