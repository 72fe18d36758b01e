"""Forces of position on the load: gravity and contact, by their mean over a substep.

Both are taken as discrete gradients of their potentials, so that they conserve energy exactly;
the damping of a contact only takes energy away, and a contact never pulls.
"""

from __future__ import annotations

import math
from typing import Any

from cjt_gym.joint.kernel.compiled import apart, lean

TINY = 1e-9  # [rad]


@lean
def has_load_force(p: Any) -> bool:
    """Whether gravity or a contact acts on the load."""
    return bool(p.weight > 0.0 or p.contact_stiffness > 0.0)


@lean
def mean_gravity(p: Any, start: float, rate: float, h: float) -> tuple[float, float]:
    """Return the mean of weight sin(q - angle) over a substep [N m] and its slope [N m s/rad]."""
    half = 0.5 * h * rate
    middle = start + half - p.weight_angle
    spread = math.sin(half) / half if abs(half) > TINY else 1.0
    return p.weight * math.sin(middle) * spread, p.weight * math.cos(middle) * spread * 0.5 * h


@lean
def contact_torque(p: Any, q: float, dq: float) -> float:
    """Return the torque of the contact at an instant [N m].

    References:
        Hunt, Crossley (1975), Journal of Applied Mechanics 42(2).
    """
    x = max(0.0, q - p.contact_position)
    return float(
        p.contact_stiffness * x**p.contact_exponent * max(0.0, 1.0 + p.contact_damping * dq)
    )


@lean
def mean_contact(p: Any, start: float, rate: float, h: float) -> tuple[float, float]:
    """Return the mean torque of the contact over a substep [N m] and its slope [N m s/rad]."""
    end = start + h * rate
    x0, x1 = max(0.0, start - p.contact_position), max(0.0, end - p.contact_position)
    if x0 == 0.0 and x1 == 0.0:
        return 0.0, 0.0
    e = p.contact_exponent
    local = p.contact_stiffness * x1**e
    if abs(end - start) > TINY:
        stored = p.contact_stiffness * (x1 ** (e + 1.0) - x0 ** (e + 1.0)) / (e + 1.0)
        elastic = stored / (end - start)
        slope = (local - elastic) / rate
    else:
        middle = 0.5 * (x0 + x1)
        elastic = p.contact_stiffness * middle**e
        slope = 0.5 * h * e * p.contact_stiffness * middle ** (e - 1.0)
    grip = 1.0 + p.contact_damping * rate
    if grip <= 0.0:
        return 0.0, 0.0
    return elastic * grip, slope * grip + elastic * p.contact_damping


@apart
def load_force(p: Any, start: float, rate: float, h: float) -> tuple[float, float]:
    """Return the mean torque against the load over a substep [N m] and its slope [N m s/rad]."""
    torque, slope = 0.0, 0.0
    if p.weight > 0.0:
        t, s = mean_gravity(p, start, rate, h)
        torque += t
        slope += s
    if p.contact_stiffness > 0.0:
        t, s = mean_contact(p, start, rate, h)
        torque += t
        slope += s
    return torque, slope
