"""Friction of one body.

Friction opposes motion: its torque is minus the values returned here.
"""

from __future__ import annotations

import math
from typing import Any

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
def extra_damping(p: Any, body: int) -> float:
    """Return what the viscous damping gains at negative velocity [N m s/rad]."""
    if body == MOTOR:
        return float(p.d_m_extra_n)
    if body == GEAR:
        return float(p.d_g_extra_n)
    return float(p.d_l_extra_n)


@compiled
def friction(p: Any, body: int, dq: float, side: float) -> tuple[float, float]:
    """Return the friction torque of a body and its slope over velocity.

        tau = d_c(+/-) * tanh(dq / dq_0) + (d_n - d) * min(dq, 0)

    With dq_0 = 0 the sign is sharp: the slope of the jump is left out, and at dq = 0 the
    value is the limit from `side`.

    Args:
        p: Parameter record.
        body: MOTOR, GEAR or LOAD.
        dq: Velocity of the body [rad/s].
        side: +1 or -1, the direction of motion, which counts where dq = 0.

    Returns:
        Torque [N m] and slope [N m s/rad].

    References:
        Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB, section
        Nonlinear Dynamics.
    """
    up, down = coulomb_levels(p, body)
    level = up if side > 0.0 else down
    if level == 0.0:
        torque, slope = 0.0, 0.0
    elif p.dq_0 > 0.0:
        s = math.tanh(dq / p.dq_0)
        torque, slope = level * s, level * (1.0 - s * s) / p.dq_0
    else:
        torque, slope = level * side, 0.0
    if dq < 0.0:
        extra = extra_damping(p, body)
        torque += extra * dq
        slope += extra
    return torque, slope


@compiled
def has_friction(p: Any, body: int) -> bool:
    """Whether any friction beyond the linear damping acts on the body."""
    up, down = coulomb_levels(p, body)
    return up != 0.0 or down != 0.0 or extra_damping(p, body) != 0.0
