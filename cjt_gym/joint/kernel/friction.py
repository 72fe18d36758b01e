"""Friction of one body.

Friction opposes motion: its torque is minus the values returned here. Every dry law has a level,

    g(dq) = d_c(+/-) + d_s exp(-(dq / v_s)^2) + mu |tau|,

the Coulomb level of the direction, the breakaway above it and what the transmitted torque adds.
A body slides under g tanh(dq / dq_0), or under g sign(dq) where dq_0 = 0; a body with bristles
feels them instead.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.kernel.arrays import (
    BODY,
    BRISTLE,
    DOWN,
    EXCESS,
    EXTRA,
    LAW,
    MESH,
    MU,
    SIGMA,
    UP,
    Floats,
    OneJoint,
)
from cjt_gym.joint.kernel.compiled import apart, inlined, lean

MOTOR, GEAR, LOAD = 0, 1, 2
LEAST = 1e-9  # level below which there is no friction [N m]
NONE, COULOMB, SLIDING, BRISTLES = 0.0, 1.0, 2.0, 3.0  # laws; higher numbers cost more


@lean
def note_friction(p: Any, work: Floats) -> None:
    """Write the friction of the three bodies into the rows from BODY on."""
    for body in range(3):
        row = BODY + body
        if body == MOTOR:
            work[row, UP], work[row, DOWN], work[row, EXCESS] = p.d_cm, p.d_cm_n, p.d_sm
            work[row, MU], work[row, SIGMA], work[row, EXTRA] = p.mu_m, p.sigma_m, p.d_m_extra_n
        elif body == GEAR:
            work[row, UP], work[row, DOWN], work[row, EXCESS] = p.d_cg, p.d_cg_n, p.d_sg
            work[row, MU], work[row, SIGMA], work[row, EXTRA] = p.mu_g, p.sigma_g, p.d_g_extra_n
        else:
            work[row, UP], work[row, DOWN], work[row, EXCESS] = p.d_cl, p.d_cl_n, p.d_sl
            work[row, MU], work[row, SIGMA], work[row, EXTRA] = p.mu_l, p.sigma_l, p.d_l_extra_n
        is_dry = work[row, EXCESS] != 0.0 or work[row, MU] != 0.0
        law = NONE
        if work[row, UP] != 0.0 or work[row, DOWN] != 0.0 or work[row, EXTRA] != 0.0:
            law = COULOMB
        if is_dry:
            law = SLIDING
        if law != NONE and work[row, SIGMA] > 0.0:
            law = BRISTLES
        work[row, LAW] = law


@lean
def level(
    p: Any, work: Floats, body: int, dq: float, side: float, tau: float
) -> tuple[float, float]:
    """Return the level g of dry friction [N m] and its slope over velocity [N m s/rad].

    References:
        Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7).
    """
    row = BODY + body
    total, slope = work[row, UP] if side > 0.0 else work[row, DOWN], 0.0
    if work[row, LAW] == COULOMB:
        return total, slope
    excess = work[row, EXCESS]
    if excess != 0.0 and p.v_s > 0.0:
        ratio = dq / p.v_s
        bump = excess * math.exp(-ratio * ratio)
        total += bump
        slope -= 2.0 * bump * ratio / p.v_s
    return total + work[row, MU] * abs(tau), slope


@lean
def coulomb_friction(
    dq_0: float, work: Floats, row: int, dq: float, side: float
) -> tuple[float, float]:
    """Return the friction of a body that has only Coulomb and one-sided viscous friction."""
    g = work[row, UP] if side > 0.0 else work[row, DOWN]
    if dq_0 > 0.0:
        s = math.tanh(dq / dq_0)
        torque, slope = g * s, g * (1.0 - s * s) / dq_0
    else:
        torque, slope = g * side, 0.0
    if dq < 0.0:
        torque += work[row, EXTRA] * dq
        slope += work[row, EXTRA]
    return torque, slope


@lean
def sliding_friction(
    p: Any, work: Floats, body: int, dq: float, side: float, tau: float
) -> tuple[float, float]:
    """Return the friction of a sliding body [N m] and its slope over velocity [N m s/rad].

    With dq_0 = 0 the sign is sharp: the slope of the jump is left out, and at dq = 0 the
    value is the limit from `side`.

    References:
        Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB, section
        Nonlinear Dynamics.
    """
    g, falling = level(p, work, body, dq, side, tau)
    if g == 0.0:
        torque, slope = 0.0, 0.0
    elif p.dq_0 > 0.0:
        s = math.tanh(dq / p.dq_0)
        torque, slope = g * s, g * (1.0 - s * s) / p.dq_0 + falling * s
    else:
        torque, slope = g * side, falling * side
    if dq < 0.0:
        torque += work[BODY + body, EXTRA] * dq
        slope += work[BODY + body, EXTRA]
    return torque, slope


@apart
def bristles(
    sigma: tuple[float, float],
    level: tuple[float, float],
    z: float,
    dq: float,
    side: float,
    h: float,
) -> tuple[float, float, float]:
    """Advance the bristles of a body at constant velocity over h [s], exactly.

        dz/dt = dq - sigma_0 |dq| z / g(dq),     torque = sigma_0 z + sigma_1 dz/dt

    `sigma` holds sigma_0 and sigma_1, `level` g and its slope. Returned are the mean torque over h
    [N m], its slope over velocity [N m s/rad] and the new deflection; the torque is the mean so
    that its work is that of the continuous law, which is passive for sigma_1 <= 4 g / |dq|; a
    larger one is limited to that.

    References:
        Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Transactions on Automatic
        Control 40(3); Barahanov, Ortega (2000), IEEE Transactions on Automatic Control 45(4).
    """
    stiffness, damping = sigma
    g, falling = level
    if g <= LEAST:
        return 0.0, 0.0, 0.0
    a = stiffness * abs(dq) * h / g
    rise = stiffness * h * side / g - a * falling / g
    final, final_slope = side * g / stiffness, side * falling / stiffness
    decay = math.exp(-a)
    if a > 1e-4:
        mean = -math.expm1(-a) / a
        mean_slope = (decay - mean) / a
    else:
        mean, mean_slope = 1.0 - 0.5 * a, -0.5 + a / 3.0
    new = final + (z - final) * decay
    torque = stiffness * (final + (z - final) * mean)
    slope = stiffness * (final_slope * (1.0 - mean) + (z - final) * mean_slope * rise)
    if damping * abs(dq) > 4.0 * g:
        damping = 4.0 * g / abs(dq)
    if damping > 0.0:
        torque += damping * (new - z) / h
        slope += damping * (final_slope * (1.0 - decay) - (z - final) * decay * rise) / h
    return torque, slope, new


@inlined
def own_bristles(joint: OneJoint, body: int, dq: float, side: float) -> tuple[float, float, float]:
    """Return what `bristles` does over a substep, from the deflection and torque in memory."""
    memory = joint.memory
    sigma = joint.work[BODY + body, SIGMA], joint.p.sigma_1
    dry = level(joint.p, joint.work, body, dq, side, memory[MESH])
    return bristles(sigma, dry, memory[BRISTLE + body], dq, side, joint.setup.h)


@inlined
def friction(joint: OneJoint, body: int, dq: float, side: float) -> tuple[float, float]:
    """Return the mean friction of a body at constant velocity over a substep, and its slope."""
    work = joint.work
    if work[BODY + body, LAW] != BRISTLES:
        return sliding_friction(joint.p, work, body, dq, side, joint.memory[MESH])
    torque, slope, _ = own_bristles(joint, body, dq, side)
    if dq < 0.0:
        torque += work[BODY + body, EXTRA] * dq
        slope += work[BODY + body, EXTRA]
    return torque, slope


@inlined
def dry_level(joint: OneJoint, body: int, side: float) -> float:
    """Return the set-valued friction that can hold a body at rest [N m]; 0 with bristles."""
    if joint.work[BODY + body, LAW] == BRISTLES:
        return 0.0
    g, _ = level(joint.p, joint.work, body, 0.0, side, joint.memory[MESH])
    return g
