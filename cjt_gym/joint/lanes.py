"""Many joints side by side: the substeps of the most common joints, in vector registers.

The same equations and the same scheme as `substep`, for joints that a current source drives
through linear springs, with Coulomb and one-sided viscous friction (smooth or sharp) and cogging.
Joints form blocks: each quantity of a block is a row of one number per joint, so that the innermost
loops run over joints, without branches. Structure, friction and the number of
cogging harmonics are constants of the compiled code. A joint whose equations are not solved here
is left as it was, for the general kernel.
"""

from __future__ import annotations

from typing import NamedTuple

from cjt_gym.joint.arrays import Floats
from cjt_gym.joint.compiled import inlined
from cjt_gym.joint.vector_math import sine_cosine, tanh

NEWTON = 20
SWEEPS = 60
SHARP_SOLVED = 1e-15  # change of speed in the last sweep, relative to the largest so far


class Shape(NamedTuple):
    """What the compiled code of a kind of joint is made for.

    Attributes:
        order: Number of mechanical states.
        size: Number of coordinates.
        rubbing: The coordinates with friction.
        sharp: Whether the sign of the velocity is sharp (dq_0 = 0).
        harmonics: Number of cogging harmonics.
        width: Joints per block.
    """

    order: int
    size: int
    rubbing: tuple[int, ...]
    sharp: bool
    harmonics: int
    width: int


class Rows(NamedTuple):
    """Where the quantities of a block begin, in rows of `width` numbers."""

    x: int
    a: int
    b: int
    motor: int
    load: int
    mobility: int
    up: int
    down: int
    extra: int
    steep: int
    harmonics: int
    peak: int
    offset: int
    k_b: int
    d_gl: int
    late: int
    late_sub: int
    plain: int
    usable: int
    command: int
    current: int
    later: int
    push: int
    free: int
    ripple: int
    speed: int
    wanted: int
    drag: int
    busy: int
    failed: int
    count: int


class Plan(NamedTuple):
    """The constants of a block: its shape, and where its rows begin in numbers."""

    order: int
    velocity: int
    n: int
    width: int
    harmonics: int
    sharp: bool
    first: int
    second: int
    third: int
    at: Rows


def plan_of(shape: Shape) -> Plan:
    """Return the constants of a shape."""
    one, two, three = (*shape.rubbing, 0, 0, 0)[:3]
    return Plan(
        shape.order,
        shape.order - shape.size,
        len(shape.rubbing),
        shape.width,
        shape.harmonics,
        shape.sharp,
        one,
        two,
        three,
        Rows(*(row * shape.width for row in rows_of(shape))),
    )


def rows_of(shape: Shape) -> Rows:
    """Return where the rows of a shape begin."""
    order, rubbing = shape.order, len(shape.rubbing)
    lengths = (
        *(order, order * order, order * rubbing, order, order, rubbing * rubbing),
        *(rubbing, rubbing, rubbing, 1, 3 * shape.harmonics),
        *(1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1),
        *(order, order, 1, rubbing, rubbing, rubbing, 1, 1),
    )
    starts = [sum(lengths[:k]) for k in range(len(lengths) + 1)]
    return Rows(*starts)


@inlined
def coordinate(c: Plan, k: int) -> int:
    """Return which coordinate is number k of those with friction."""
    return c.first if k == 0 else (c.second if k == 1 else c.third)


@inlined
def drag(c: Plan, s: Floats, k: int, lane: int, v: float) -> tuple[float, float]:
    """Return the smooth friction on coordinate k at velocity v, and its slope."""
    ahead = v >= 0.0
    level = s[c.at.up + k * c.width + lane] if ahead else s[c.at.down + k * c.width + lane]
    extra = 0.0 if ahead else s[c.at.extra + k * c.width + lane]
    steep = s[c.at.steep + lane]
    t = tanh(v * steep)
    return level * t + extra * v, level * (1.0 - t * t) * steep + extra


@inlined
def predict(c: Plan, s: Floats) -> None:
    """Take friction at the present speed, and no ripple."""
    for lane in range(c.width):
        s[c.at.ripple + lane] = 0.0
        for k in range(c.n):
            v = s[c.at.x + (c.velocity + coordinate(c, k)) * c.width + lane]
            if c.sharp:
                up, down = s[c.at.up + k * c.width + lane], s[c.at.down + k * c.width + lane]
                behind = s[c.at.extra + k * c.width + lane] * v - down
                held = 0.5 * (up - down)
                s[c.at.drag + k * c.width + lane] = up if v > 0.0 else (behind if v < 0.0 else held)
            else:
                s[c.at.drag + k * c.width + lane], _ = drag(c, s, k, lane, v)


@inlined
def move(c: Plan, s: Floats) -> None:
    """Advance the linear joint."""
    for lane in range(c.width):
        for i in range(c.order):
            value = s[c.at.push + i * c.width + lane]
            for j in range(c.order):
                value += (
                    s[c.at.a + (i * c.order + j) * c.width + lane] * s[c.at.x + j * c.width + lane]
                )
            s[c.at.free + i * c.width + lane] = value


@inlined
def cog(c: Plan, s: Floats, h: float) -> None:
    """Find the ripple in the middle of the motion that the last friction and ripple give."""
    for lane in range(c.width):
        ripple, q, dq = (
            s[c.at.ripple + lane],
            s[c.at.free + lane],
            s[c.at.free + c.velocity * c.width + lane],
        )
        q += s[c.at.motor + lane] * ripple
        dq += s[c.at.motor + c.velocity * c.width + lane] * ripple
        for k in range(c.n):
            q -= s[c.at.b + k * c.width + lane] * s[c.at.drag + k * c.width + lane]
            dq -= (
                s[c.at.b + (c.velocity * c.n + k) * c.width + lane]
                * s[c.at.drag + k * c.width + lane]
            )
        q = 0.5 * (s[c.at.x + lane] + q) + 0.125 * h * (
            s[c.at.x + c.velocity * c.width + lane] - dq
        )
        total = 0.0
        for j in range(c.harmonics):
            row = c.at.harmonics + 3 * j * c.width + lane
            sine, cosine = sine_cosine(s[row] * q)
            total += s[row + c.width] * cosine + s[row + 2 * c.width] * sine
        s[c.at.ripple + lane] = total


@inlined
def aim(c: Plan, s: Floats, h: float) -> None:
    """Note the mean speeds without friction, and those under the friction before."""
    for lane in range(c.width):
        s[c.at.busy + lane] = 1.0
        for i in range(c.order):
            if c.harmonics > 0:
                s[c.at.free + i * c.width + lane] += (
                    s[c.at.motor + i * c.width + lane] * s[c.at.ripple + lane]
                )
        for k in range(c.n):
            g = coordinate(c, k)
            s[c.at.wanted + k * c.width + lane] = (
                s[c.at.free + g * c.width + lane] - s[c.at.x + g * c.width + lane]
            ) / h
        for k in range(c.n):
            v = s[c.at.wanted + k * c.width + lane]
            for m in range(c.n):
                v -= (
                    s[c.at.mobility + (k * c.n + m) * c.width + lane]
                    * s[c.at.drag + m * c.width + lane]
                )
            s[c.at.speed + k * c.width + lane] = v


@inlined
def newton(c: Plan, s: Floats) -> int:
    """Take one step of Newton's method; return how many joints are not at the solution."""
    unsolved = 0
    for lane in range(c.width):
        v1, v2, v3 = s[c.at.speed + lane], 0.0, 0.0
        r1, g1 = drag(c, s, 0, lane, v1)
        r2, g2, r3, g3 = 0.0, 0.0, 0.0, 0.0
        if c.n > 1:
            v2 = s[c.at.speed + c.width + lane]
            r2, g2 = drag(c, s, 1, lane, v2)
        if c.n > 2:
            v3 = s[c.at.speed + 2 * c.width + lane]
            r3, g3 = drag(c, s, 2, lane, v3)
        w11 = s[c.at.mobility + lane]
        e1, j11 = v1 - s[c.at.wanted + lane] + w11 * r1, 1.0 + w11 * g1
        e2, e3, d1, d2, d3 = 0.0, 0.0, 0.0, 0.0, 0.0
        if c.n == 1:
            d1 = e1 / j11
        else:
            w12, w21 = s[c.at.mobility + c.width + lane], s[c.at.mobility + c.n * c.width + lane]
            w22 = s[c.at.mobility + (c.n + 1) * c.width + lane]
            e1 += w12 * r2
            e2 = v2 - s[c.at.wanted + c.width + lane] + w21 * r1 + w22 * r2
            j12, j21, j22 = w12 * g2, w21 * g1, 1.0 + w22 * g2
            if c.n == 2:
                scale = 1.0 / (j11 * j22 - j12 * j21)
                d1, d2 = (j22 * e1 - j12 * e2) * scale, (j11 * e2 - j21 * e1) * scale
            else:
                w13, w23 = (
                    s[c.at.mobility + 2 * c.width + lane],
                    s[c.at.mobility + (c.n + 2) * c.width + lane],
                )
                w31, w32 = (
                    s[c.at.mobility + 2 * c.n * c.width + lane],
                    s[c.at.mobility + (2 * c.n + 1) * c.width + lane],
                )
                w33 = s[c.at.mobility + (2 * c.n + 2) * c.width + lane]
                e1 += w13 * r3
                e2 += w23 * r3
                e3 = v3 - s[c.at.wanted + 2 * c.width + lane] + w31 * r1 + w32 * r2 + w33 * r3
                j13, j23, j33 = w13 * g3, w23 * g3, 1.0 + w33 * g3
                j31, j32 = w31 * g1, w32 * g2
                c11, c12, c13 = j22 * j33 - j23 * j32, j13 * j32 - j12 * j33, j12 * j23 - j13 * j22
                c21, c22, c23 = j23 * j31 - j21 * j33, j11 * j33 - j13 * j31, j13 * j21 - j11 * j23
                c31, c32, c33 = j21 * j32 - j22 * j31, j12 * j31 - j11 * j32, j11 * j22 - j12 * j21
                scale = 1.0 / (j11 * c11 + j12 * c21 + j13 * c31)
                d1 = (c11 * e1 + c12 * e2 + c13 * e3) * scale
                d2 = (c21 * e1 + c22 * e2 + c23 * e3) * scale
                d3 = (c31 * e1 + c32 * e2 + c33 * e3) * scale
        # What is solved stays, so that a joint moves as it would alone.
        busy = s[c.at.busy + lane] != 0.0
        s[c.at.speed + lane] = v1 - d1 if busy else v1
        s[c.at.drag + lane] = r1 - g1 * d1 if busy else s[c.at.drag + lane]
        # 1e-10 rad/s + 1e-7 dq_0, and what rounding leaves of the speed
        enough = 1e-10 + 1e-7 / s[c.at.steep + lane]
        solved = abs(d1) - 1e-9 * abs(v1) <= enough
        if c.n > 1:
            held = s[c.at.drag + c.width + lane]
            s[c.at.speed + c.width + lane] = v2 - d2 if busy else v2
            s[c.at.drag + c.width + lane] = r2 - g2 * d2 if busy else held
            solved &= abs(d2) - 1e-9 * abs(v2) <= enough
        if c.n > 2:
            held = s[c.at.drag + 2 * c.width + lane]
            s[c.at.speed + 2 * c.width + lane] = v3 - d3 if busy else v3
            s[c.at.drag + 2 * c.width + lane] = r3 - g3 * d3 if busy else held
            solved &= abs(d3) - 1e-9 * abs(v3) <= enough
        busy = busy and not solved
        s[c.at.busy + lane] = 1.0 if busy else 0.0
        unsolved += 1 if busy else 0
    return unsolved


@inlined
def project(c: Plan, s: Floats) -> int:
    """Solve for one coordinate with sharp friction after the other; return as `newton` does."""
    unsolved = 0
    for lane in range(c.width):
        change, busy = 0.0, s[c.at.busy + lane] != 0.0
        for k in range(c.n):
            w = s[c.at.mobility + (k * c.n + k) * c.width + lane]
            before = s[c.at.drag + k * c.width + lane]
            target = s[c.at.wanted + k * c.width + lane] + w * before
            for m in range(c.n):
                target -= (
                    s[c.at.mobility + (k * c.n + m) * c.width + lane]
                    * s[c.at.drag + m * c.width + lane]
                )
            up, down = s[c.at.up + k * c.width + lane], s[c.at.down + k * c.width + lane]
            extra = s[c.at.extra + k * c.width + lane]
            ahead, behind = target - w * up, (target + w * down) / (1.0 + w * extra)
            v = ahead if ahead > 0.0 else (behind if behind < 0.0 else 0.0)
            torque = up if ahead > 0.0 else (extra * v - down if behind < 0.0 else target / w)
            s[c.at.speed + k * c.width + lane] = v if busy else s[c.at.speed + k * c.width + lane]
            s[c.at.drag + k * c.width + lane] = torque if busy else before
            moved = abs(torque - before) * w - 1e-13 * abs(target)
            change = moved if not moved <= change else change
        busy = busy and not change <= SHARP_SOLVED
        s[c.at.busy + lane] = 1.0 if busy else 0.0
        unsolved += 1 if busy else 0
    return unsolved


@inlined
def arrive(c: Plan, s: Floats) -> None:
    """Add the friction that was found; what sharp friction has stopped comes to rest."""
    for lane in range(c.width):
        for i in range(c.order):
            value = s[c.at.free + i * c.width + lane]
            for k in range(c.n):
                value -= (
                    s[c.at.b + (i * c.n + k) * c.width + lane] * s[c.at.drag + k * c.width + lane]
                )
            s[c.at.free + i * c.width + lane] = value
        if c.sharp:
            for k in range(c.n):
                g = coordinate(c, k)
                row = c.velocity + g
                v, end = s[c.at.speed + k * c.width + lane], s[c.at.free + row * c.width + lane]
                up, down = s[c.at.up + k * c.width + lane], s[c.at.down + k * c.width + lane]
                gained = end - s[c.at.x + row * c.width + lane]
                dry = up if v > 0.0 else -down
                needed = gained / s[c.at.b + (row * c.n + k) * c.width + lane] + dry
                turned = (end * v < 0.0) & (-down <= needed) & (needed <= up)
                rests = (v == 0.0) & (up + down != 0.0)
                here = s[c.at.x + g * c.width + lane]
                s[c.at.free + g * c.width + lane] = (
                    here if rests else s[c.at.free + g * c.width + lane]
                )
                s[c.at.free + row * c.width + lane] = 0.0 if (turned | rests) else end
        for i in range(c.order):
            s[c.at.x + i * c.width + lane] = s[c.at.free + i * c.width + lane]


@inlined
def run(c: Plan, s: Floats, begin: int, count: int, h: float) -> None:
    """Take some substeps, and note whose equations stay unsolved.

    Substep 0 predicts friction and ripple anew.
    """
    for step in range(begin, begin + count):
        if step == 0:
            predict(c, s)
        move(c, s)
        if c.harmonics > 0:
            if step == 0:
                cog(c, s, h)
            cog(c, s, h)
        if c.n > 0 or c.harmonics > 0:
            aim(c, s, h)
        if c.n > 0:
            unsolved = 1
            for _ in range(SWEEPS if c.sharp else NEWTON):
                unsolved = project(c, s) if c.sharp else newton(c, s)
                if unsolved == 0:
                    break
            if unsolved > 0:
                for lane in range(c.width):
                    s[c.at.failed + lane] += s[c.at.busy + lane]
        arrive(c, s)
