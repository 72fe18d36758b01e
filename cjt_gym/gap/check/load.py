"""What a record shows of a free load: inertia, friction, gravity."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.friction import seen, seen_inertia
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, no_balance
from cjt_gym.gap.check.view import View

WEIGHT = 1.0
"""Upper limit on the smallest gravity torque, relative to the driving torque: that of a pendulum
that is swung up exceeds its motor's."""
FREE = "Record with a free load, its angle q_l and the joint torque tau."
OFFSET = "On a straight axis look for a weight as torque_offset."
HELD = Unseen("the output is held", FREE)


def no_load(view: View) -> Unseen | None:
    """Return why the load cannot be distinguished from the motor, or None if it can."""
    if view.structure.output_fixed:
        return HELD
    if view.load is not None:
        return None
    if "tau" not in view and not view.wound:
        why = "no joint torque tau is recorded: the load cannot be told from the motor"
        return Unseen(why, FREE)
    if view.load_angle is None and view.structure.has_spring:
        return Unseen("the load's angle q_l is not recorded", FREE)
    return Unseen("the load does not move by more than its noise", FREE)


def load_inertia(view: View) -> Verdict:
    """Judge the load's inertia, which requires inertial torque above the torque's noise."""
    if (none := no_load(view)) is not None:
        return none
    balance = view.load
    assert balance is not None
    quick = "Record quick motion of the load."
    return seen_inertia(balance, view.value("I_l"), view.inertia_unit, quick)


def load_coulomb(view: View) -> Verdict:
    """Judge the load's dry friction, which requires motion under a measured torque."""
    if (none := no_load(view)) is not None:
        return none
    balance = view.load
    assert balance is not None
    instead = "Record slow and fast motion of the load, in both directions."
    return seen(view, balance, balance["s"], ("a", "v"), view.torque_unit, instead)


def gravity(view: View) -> Verdict:
    """Judge gravity, which requires travel over which sine and cosine of the angle vary."""
    if view.structure.output_fixed:
        return HELD
    if view.angle_unit == "m":
        return Unseen("on a straight axis a weight is a constant force", OFFSET)
    balance = view.load if view.structure.has_spring and view.load is not None else view.motor
    if balance is None:
        return no_balance(view) or Unseen("the load does not move", FREE)
    angle, slow = balance["q"], balance.slow(1.0, view.dt)
    names, instead = ("a", "v", "s", "one"), "Record motion over half a turn of the load, slowly."
    waves = [wave(angle - angle.mean()) * slow for wave in (np.sin, np.cos)]
    found = [seen(view, balance, x, names, view.torque_unit, instead, WEIGHT) for x in waves]
    best = next((verdict for verdict in found if isinstance(verdict, Seen)), None)
    if best is not None:
        return best
    way = f"the load moves over {np.ptp(angle):.2g} rad"
    assert isinstance(found[0], Unseen)
    return Unseen(f"{way}, so that {found[0].why}", instead)
