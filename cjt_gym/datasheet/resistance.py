"""Friction and ripple as the effects of a joint file make them, drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cjt_gym.characteristics import coulomb, viscous, with_effects
from cjt_gym.characteristics.motor import Floats
from cjt_gym.datasheet.drawing import COLOURS, HALF, INK, canvas
from cjt_gym.datasheet.drawing import legend as place_legend
from cjt_gym.datasheet.notation import drawn
from cjt_gym.joint import Joint, JointFile
from cjt_gym.joint.effects.friction import DRY
from cjt_gym.joint.kernel.ripple import RIPPLES

PERIODS = 3.0  # of the slowest ripple, to see that it repeats
DAMPINGS = ("d_m", "d_g", "d_l")
SHARE = 0.2
"""Share of the peak torque at which ripple that grows with the torque is drawn."""

EFFECTS = {*DRY, *("viscous_asym", "load_friction", "damping"), *RIPPLES}
"""Effects that the drawing shows."""


def friction_over_speed(joint: Joint, speed: Floats) -> Floats:
    """Return the friction of all bodies at a common velocity [N m], shape of `speed`.

    Where no effect says otherwise, Coulomb friction is that of the parameters.
    """
    still = np.zeros((*speed.shape, 3))
    moving = np.repeat(speed[..., None], 3, axis=-1)
    drag = joint.nonlinear_torque(still, still) - joint.nonlinear_torque(still, moving)
    record, _ = joint.packed()
    damping = sum(float(record[name][0]) for name in DAMPINGS)
    known = 0.0 if DRY & set(joint.effects) else coulomb(joint.parameters)
    return np.asarray(drag.sum(axis=-1) + damping * speed + known * np.sign(speed))


def has_ripple(files: Sequence[JointFile]) -> bool:
    """Return whether a joint has a ripple, which is drawn beside friction."""
    return any(set(RIPPLES) & set(with_effects(file).effects) for file in files)


def friction_and_ripple(files: Sequence[JointFile]) -> str | None:
    """Return the drawing; None where no joint has an effect of the motor that is drawn here."""
    joints = [with_effects(file) for file in files]
    if not any(EFFECTS & set(joint.effects) for joint in joints):
        return None
    with canvas(2.0 * HALF, 2.3) as (figure, written):
        left, right = figure.subplots(1, 2)
        for joint, colour in zip(joints, COLOURS, strict=False):
            p = joint.parameters
            top = p.get("dq_p", max(1.0, 4.0 * joint.setting("coulomb", "dq_0")))
            speed = np.concatenate([-np.geomspace(top, 1e-4 * top, 300),
                                    np.geomspace(1e-4 * top, top, 300)])  # fmt: skip
            left.plot(speed, friction_over_speed(joint, speed), color=colour, label=drawn(p.name))
            if len(joints) == 1:
                nominal = coulomb(p) * np.sign(speed) + viscous(p) * speed
                left.plot(speed, nominal, color=INK, lw=0.8, ls="--")
            if set(RIPPLES) & set(joint.effects):
                right.plot(*_ripple(joint), color=colour)
        right.set_visible(bool(right.lines))
        p = joints[0].parameters
        left.set_xlabel(f"speed [{p.unit('dq_p')}]")
        left.set_ylabel(f"friction [{p.unit('d_cm')}]")
        right.set_xlabel("motor angle at the link [rad]" if p.axis == "rotary" else "position [m]")
        right.set_ylabel(f"ripple [{p.unit('d_cm')}]")
        if len(joints) > 1:
            place_legend(left)
        return written()


def _ripple(joint: Joint) -> tuple[Floats, Floats]:
    """Return motor angles over some periods, and the torque of ripple at rest there."""
    orders = [
        order for name in RIPPLES if name in joint.effects
        for order in np.atleast_1d(np.asarray(joint.effects[name]["f"], dtype=float))
    ]  # fmt: skip
    lowest = min((x for x in orders if x > 0.0), default=1.0)
    angle = np.linspace(0.0, PERIODS * 2.0 * math.pi / lowest, 600)
    at, still = np.zeros((len(angle), 3)), np.zeros((len(angle), 3))
    at[:, 0] = angle
    tau = SHARE * joint.torque_limit if math.isfinite(joint.torque_limit) else 0.0
    return angle, np.asarray(joint.nonlinear_torque(at, still, tau)[:, 0])
