"""Springs of gear and torsion bar that are not linear: play, hardening, hysteresis, tables.

The linear joint contains both springs as if they were linear. What they really give is added
here as a torque that is constant over the substep and equals the mean of the real torque along
the substep's path. For the part with a potential this is the discrete gradient
(V(x1) - V(x0)) / (d1 - d0), so that energy is conserved exactly; for hysteresis the mean is
integrated along the path, so that a closed loop takes energy exactly as the law says.

References:
    Gonzalez (1996), Time integration and discrete Hamiltonian systems, Journal of Nonlinear
    Science 6; Nordin, Gutman (2002), Automatica 38(10).
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.kernel.arrays import LOOP, Floats, Setup
from cjt_gym.joint.kernel.compiled import apart, lean
from cjt_gym.joint.kernel.spring_table import mean_torque, table_torque

GEAR_SPRING, BAR = 0, 1
YIELD_SPAN = 3.0  # the last Maxwell element yields at this many delta_h
MOST_ELEMENTS = 8  # of Maxwell slip
TINY = 1e-13  # [rad]


@lean
def plays(groups: tuple[int, int, int], which: int) -> bool:
    """Whether the play is in series with this spring."""
    return (which == GEAR_SPRING) == (groups[0] != groups[1])


@lean
def has_play(p: Any, groups: tuple[int, int, int], which: int) -> bool:
    """Whether this spring has play and is thus not part of the linear joint."""
    return bool(p.play_gap > 0.0 and plays(groups, which))


@lean
def is_nonlinear(p: Any, groups: tuple[int, int, int], which: int) -> bool:
    """Whether a spring differs from its linear model."""
    one, other = groups[which], groups[which + 1]
    if one == other:
        return False
    if has_play(p, groups, which):
        return True
    return bool(which == BAR and (p.k_3 > 0.0 or p.tau_h > 0.0 or p.table_scale > 0.0))


@lean
def linear_spring(p: Any, which: int) -> tuple[float, float]:
    """Return stiffness [N m/rad] and damping [N m s/rad] of a spring of the linear joint."""
    if which == BAR:
        return p.k_b, p.d_gl
    return p.k_g, p.d_mg


@lean
def beyond_play(deflection: float, gap: float, offset: float) -> float:
    """Return how far a spring is deflected beyond its play [rad]."""
    x = deflection - offset
    if x > 0.5 * gap:
        return x - 0.5 * gap
    if x < -0.5 * gap:
        return x + 0.5 * gap
    return 0.0


@lean
def bouc_wen(zeta: float, dx: float, scale: float) -> tuple[float, float]:
    """Advance the Bouc-Wen law with exponent 1 and beta = gamma = 1/2, exactly.

        scale dzeta = dx - (|dx| zeta + dx |zeta|) / 2

    Returned are the new state, in [-1, 1], and its integral over the path [rad].

    References:
        Ismail, Ikhouane, Rodellar (2009), Archives of Computational Methods in Engineering 16.
    """
    side = 1.0 if dx >= 0.0 else -1.0
    state, left, area = side * zeta, abs(dx), 0.0
    if state < 0.0:
        straight = min(left, -state * scale)
        end = state + straight / scale
        area += 0.5 * (state + end) * straight
        state, left = end, left - straight
    if left > 0.0:
        gained = (1.0 - state) * -math.expm1(-left / scale)
        area += left - scale * gained
        state += gained
    return side * state, area


@lean
def slip_stiffness(p: Any, j: int, count: int) -> tuple[float, float]:
    """Return yield deflection [rad] and stiffness [N m/rad] of Maxwell element j.

    Together `count` elements follow c tau_h (1 - exp(-x / delta_h)) at their yield deflections,
    with c such that the last of them yields at tau_h.
    """
    step = YIELD_SPAN * p.delta_h / count
    here = math.exp(-step * j / p.delta_h)
    height = p.tau_h / -math.expm1(-YIELD_SPAN)
    slope = height * here * -math.expm1(-step / p.delta_h) / step
    after = 0.0
    if j + 1 < count:
        after = slope * math.exp(-step / p.delta_h)
    return step * (j + 1), slope - after


@lean
def hysteresis(p: Any, memory: Floats, dx: float, keep: bool, held: float) -> tuple[float, float]:
    """Return the torque after a change of deflection [N m], its integral over the path [N m rad].

    References:
        Al-Bender, Lampaert, Swevers (2005), IEEE Transactions on Automatic Control 50(11).
    """
    count = int(p.slip_elements)
    if count == 0:
        state, area = bouc_wen(held * memory[LOOP], dx, p.delta_h)
        if keep:
            memory[LOOP] = state
        return p.tau_h * state, p.tau_h * area
    torque, work = 0.0, 0.0
    side = 1.0 if dx >= 0.0 else -1.0
    for j in range(count):
        limit, stiffness = slip_stiffness(p, j, count)
        old = side * held * memory[LOOP + j]
        new = min(old + abs(dx), limit)
        stuck = new - old
        torque += side * stiffness * new
        work += stiffness * (0.5 * (old + new) * stuck + limit * (abs(dx) - stuck))
        if keep:
            memory[LOOP + j] = side * new
    return torque, work


@apart
def spring_torque(
    p: Any, memory: Floats, groups: tuple[int, int, int], which: int, deflection: float, rate: float
) -> float:
    """Return the torque of a spring at an instant, damper included [N m]."""
    stiffness, damping = linear_spring(p, which)
    x = deflection
    gap = p.play_gap if plays(groups, which) else 0.0
    if gap > 0.0:
        x = beyond_play(deflection, gap, p.play_offset)
        if x == 0.0:
            return 0.0
    tabled = which == BAR and p.table_scale > 0.0
    if tabled:
        torque = p.table_scale * table_torque(memory, x)[0] + damping * rate
    else:
        torque = stiffness * x + damping * rate
    if which == BAR:
        torque += p.k_3 * x * x * x
        if p.tau_h > 0.0:
            loop, _ = hysteresis(p, memory, 0.0, False, 1.0)
            torque += loop
    if gap > 0.0 and torque * x < 0.0:
        return 0.0
    return float(torque)


@lean
def path_torque(
    p: Any,
    memory: Floats,
    which: int,
    path: tuple[float, float, float, float],
    touching: bool,
    keep: bool,
    held: float,
) -> tuple[float, float]:
    """Return the mean torque of a spring over a substep, and its slope over the rate.

    The torque is in N m, the slope in N m s/rad. The path runs from x0 to x1 [rad], its first
    numbers, at a rate [rad/s] over h [s], its last. Where play takes a part of the way, x0 and x1
    are less than h rate apart; `touching` says whether the spring is deflected at the end.
    """
    x0, x1, rate, h = path
    stiffness, damping = linear_spring(p, which)
    k_3, is_loop = 0.0, False
    if which == BAR:
        k_3, is_loop = p.k_3, p.tau_h > 0.0
    tabled = which == BAR and p.table_scale > 0.0
    if tabled:
        stiffness = 0.0
    contact, travel = 1.0 if touching else 0.0, h * rate
    share = (x1 - x0) / travel if abs(travel) > TINY else contact
    torque = share * 0.5 * (x0 + x1) * (stiffness + 0.5 * k_3 * (x0 * x0 + x1 * x1))
    local = stiffness * x1 + k_3 * x1 * x1 * x1
    if tabled:
        end, stiffness = table_torque(memory, x1)
        local += p.table_scale * end
        torque += share * p.table_scale * mean_torque(memory, x0, x1)
        stiffness *= p.table_scale
    if is_loop:
        loop, work = hysteresis(p, memory, x1 - x0, keep, held)
        torque += work / travel if abs(travel) > TINY else share * loop
        local += loop
    if abs(travel) > 1e3 * TINY:
        slope = (local * contact - torque) / rate
    else:
        slope = 0.5 * h * contact * (stiffness + 3.0 * k_3 * x1 * x1)
    return torque + damping * rate * share, slope + damping * contact


@lean
def played_torque(
    p: Any, memory: Floats, setup: Setup, which: int, start: float, rate: float, keep: bool
) -> tuple[float, float]:
    """Return the mean torque of a spring with play: one side after the other, neither pulls."""
    h = setup.h
    x0 = beyond_play(start, p.play_gap, p.play_offset)
    x1 = beyond_play(start + h * rate, p.play_gap, p.play_offset)
    torque, slope = 0.0, 0.0
    side = 1.0 if rate <= 0.0 else -1.0
    for _ in range(2):
        begin, end = side * max(0.0, side * x0), side * max(0.0, side * x1)
        if begin != 0.0 or end != 0.0:
            held = 1.0 if begin != 0.0 else 0.0
            t, s = path_torque(p, memory, which, (begin, end, rate, h), end != 0.0, keep, held)
            if t * side > 0.0:
                torque += t
                slope += s
            elif keep:
                relax(memory)
        side = -side
    if keep and x1 == 0.0:
        relax(memory)
    return torque, slope


@lean
def relax(memory: Floats) -> None:
    """Reset the hysteresis of a spring without torque."""
    for j in range(MOST_ELEMENTS):
        memory[LOOP + j] = 0.0


@apart
def added_torque(
    p: Any, memory: Floats, setup: Setup, which: int, start: float, rate: float, keep: bool
) -> tuple[float, float]:
    """Return the mean torque that a spring adds to the linear joint, and its slope over rate."""
    if has_play(p, setup.groups, which):
        return played_torque(p, memory, setup, which, start, rate, keep)
    h = setup.h
    end = start + h * rate
    torque, slope = path_torque(p, memory, which, (start, end, rate, h), True, keep, 1.0)
    stiffness, damping = linear_spring(p, which)
    torque -= stiffness * 0.5 * (start + end) + damping * rate
    return torque, slope - stiffness * 0.5 * h - damping
