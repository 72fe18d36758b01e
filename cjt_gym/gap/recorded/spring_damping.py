"""Damping of a torsion bar of which a joint file states none.

No spring is without damping, and few datasheets state it. In a fit without it something else makes
up for it: a late torque sensor, hysteresis, or the damping of motor and load.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cjt_gym.gap.digits import plain
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.files.quantity import Quantity

SYMBOL = "d_gl"
USUAL = 0.01
"""Usual share of the critical damping of the body that the bar holds."""
NOT_STATED = "not stated"
BOTH = (
    " Without the joint torque, a held output does not tell it from the motor's own damping d_m: "
    "it may hold both."
)


def critical(file: JointFile, shape: Structure) -> float:
    """Return the critical damping of the body that the bar holds, 0 without a bar [N m s/rad].

    That is the load or, if the output is fixed, the motor with what moves as one with it.
    """
    p = file.parameters
    held = body_group(shape, "m" if shape.output_fixed else "l")
    inertia = sum(p.get(f"I_{body}", 0.0) for body in held)
    return 2.0 * math.sqrt(p.get("k_b", 0.0) * inertia) if shape.has_spring else 0.0


def is_stated(file: JointFile) -> bool:
    """Return whether a joint file states the damping of its bar, which may be none."""
    stated = file.parameters.quantities.get(SYMBOL)
    if stated is None or stated.source == NOT_STATED:
        return False
    return not stated.guess or stated.number > 0.0


def with_spring_damping(file: JointFile, shape: Structure) -> JointFile:
    """Return a joint file whose bar has a damping that may be any, if it states none."""
    if is_stated(file) or critical(file, shape) == 0.0:
        return file
    none = Quantity(0.0, file.parameters.unit(SYMBOL), NOT_STATED, guess=True)
    quantities = {**file.parameters.quantities, SYMBOL: none}
    return replace(file, parameters=replace(file.parameters, quantities=quantities))


def unstated_damping(file: JointFile, found: JointFile, *, alone: bool = False) -> list[str]:
    """Return a remark on the damping of a bar that a joint has and its datasheet does not state.

    Args:
        file: The datasheet.
        found: The joint that was found.
        alone: Whether nothing but the motion of a motor on a held bar shows it.
    """
    value = found.parameters.get(SYMBOL, 0.0)
    if is_stated(file) or value == 0.0:
        return []
    size = f"{plain(value)} {found.parameters.unit(SYMBOL)}"
    return [
        f"The joint file states no damping {SYMBOL} of the spring: that of joint.toml, {size}, "
        "was fitted." + (BOTH if alone else "")
    ]
