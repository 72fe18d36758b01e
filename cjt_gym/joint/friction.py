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

from cjt_gym.joint.arrays import BRISTLE, MESH, Floats
from cjt_gym.joint.compiled import compiled

MOTOR, GEAR, LOAD = 0, 1, 2


@compiled
def coulomb_levels(p: Any, body: int) -> tuple[float, float]:
    """Return the Coulomb levels for positive and negative velocity [N m]."""
    if body == MOTOR:
        return p.d_cm, p.d_cm_n
    if body == GEAR:
        return p.d_cg, p.d_cg_n
    return p.d_cl, p.d_cl_n


@compiled
def breakaway(p: Any, body: int) -> tuple[float, float]:
    """Return the breakaway above the Coulomb level [N m] and the friction per torque [-]."""
    if body == MOTOR:
        return p.d_sm, p.mu_m
    if body == GEAR:
        return p.d_sg, p.mu_g
    return p.d_sl, p.mu_l


@compiled
def bristle_stiffness(p: Any, body: int) -> float:
    """Return the stiffness of the bristles [N m/rad]; 0 where there are none."""
    if body == MOTOR:
        return float(p.sigma_m)
    if body == GEAR:
        return float(p.sigma_g)
    return float(p.sigma_l)


@compiled
def extra_damping(p: Any, body: int) -> float:
    """Return what the viscous damping gains at negative velocity [N m s/rad]."""
    if body == MOTOR:
        return float(p.d_m_extra_n)
    if body == GEAR:
        return float(p.d_g_extra_n)
    return float(p.d_l_extra_n)


@compiled
def level(p: Any, body: int, dq: float, side: float, tau: float) -> tuple[float, float]:
    """Return the level g of dry friction [N m] and its slope over velocity [N m s/rad].

    Args:
        p: Parameter record.
        body: MOTOR, GEAR or LOAD.
        dq: Velocity of the body [rad/s].
        side: +1 or -1, the direction of motion.
        tau: Transmitted torque [N m].

    References:
        Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7).
    """
    up, down = coulomb_levels(p, body)
    total, slope = up if side > 0.0 else down, 0.0
    excess, mu = breakaway(p, body)
    if excess != 0.0 and p.v_s > 0.0:
        ratio = dq / p.v_s
        bump = excess * math.exp(-ratio * ratio)
        total += bump
        slope -= 2.0 * bump * ratio / p.v_s
    if mu != 0.0:
        total += mu * abs(tau)
    return total, slope


@compiled
def sliding_friction(p: Any, body: int, dq: float, side: float, tau: float) -> tuple[float, float]:
    """Return the friction of a sliding body and its slope over velocity.

    With dq_0 = 0 the sign is sharp: the slope of the jump is left out, and at dq = 0 the
    value is the limit from `side`.

    Args:
        p: Parameter record.
        body: MOTOR, GEAR or LOAD.
        dq: Velocity of the body [rad/s].
        side: +1 or -1, the direction of motion, which counts where dq = 0.
        tau: Transmitted torque [N m].

    Returns:
        Torque [N m] and slope [N m s/rad].

    References:
        Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB, section
        Nonlinear Dynamics.
    """
    g, falling = level(p, body, dq, side, tau)
    if g == 0.0:
        torque, slope = 0.0, 0.0
    elif p.dq_0 > 0.0:
        s = math.tanh(dq / p.dq_0)
        torque, slope = g * s, g * (1.0 - s * s) / p.dq_0 + falling * s
    else:
        torque, slope = g * side, falling * side
    return with_damping(p, body, dq, torque, slope)


@compiled
def with_damping(p: Any, body: int, dq: float, torque: float, slope: float) -> tuple[float, float]:
    """Add the viscous friction that a body has at negative velocity alone."""
    if dq < 0.0:
        extra = extra_damping(p, body)
        torque += extra * dq
        slope += extra
    return torque, slope


@compiled
def bristles(
    p: Any, body: int, z: float, dq: float, side: float, tau: float, h: float
) -> tuple[float, float, float]:
    """Advance the bristles of a body at constant velocity over h [s], exactly.

        dz/dt = dq - sigma_0 |dq| z / g(dq),     torque = sigma_0 z + sigma_1 dz/dt

    The torque returned is the mean over h, so that its work is that of the continuous law, which
    is passive for sigma_1 <= 4 g / |dq|; a larger one is limited to that.

    Args:
        p: Parameter record.
        body: MOTOR, GEAR or LOAD.
        z: Deflection [rad].
        dq: Velocity of the body [rad/s].
        side: +1 or -1, the direction of motion, which counts where dq = 0.
        tau: Transmitted torque [N m].
        h: Duration [s].

    Returns:
        Mean torque [N m], its slope over velocity [N m s/rad], the new deflection [rad].

    References:
        Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Transactions on Automatic
        Control 40(3); Barahanov, Ortega (2000), IEEE Transactions on Automatic Control 45(4).
    """
    stiffness = bristle_stiffness(p, body)
    g, falling = level(p, body, dq, side, tau)
    if g <= 0.0:
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
    damping = p.sigma_1
    if damping * abs(dq) > 4.0 * g:
        damping = 4.0 * g / abs(dq)
    if damping > 0.0:
        torque += damping * (new - z) / h
        slope += damping * (final_slope * (1.0 - decay) - (z - final) * decay * rise) / h
    return torque, slope, new


@compiled
def friction(
    p: Any, memory: Floats, body: int, dq: float, side: float, h: float
) -> tuple[float, float]:
    """Return the mean friction of a body at constant velocity over h [s], and its slope.

    The memory holds the bristles' deflections and the transmitted torque.
    """
    if bristle_stiffness(p, body) > 0.0:
        torque, slope, _ = bristles(p, body, memory[BRISTLE + body], dq, side, memory[MESH], h)
        return with_damping(p, body, dq, torque, slope)
    return sliding_friction(p, body, dq, side, memory[MESH])


@compiled
def dry_level(p: Any, memory: Floats, body: int, side: float) -> float:
    """Return the set-valued friction that can hold a body at rest [N m]; 0 with bristles."""
    if bristle_stiffness(p, body) > 0.0:
        return 0.0
    g, _ = level(p, body, 0.0, side, memory[MESH])
    return g


@compiled
def has_friction(p: Any, body: int) -> bool:
    """Whether any friction beyond the linear damping acts on the body."""
    up, down = coulomb_levels(p, body)
    excess, mu = breakaway(p, body)
    return up != 0.0 or down != 0.0 or extra_damping(p, body) != 0.0 or excess != 0.0 or mu != 0.0
