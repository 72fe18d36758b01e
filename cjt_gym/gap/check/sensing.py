"""What a record shows of the torque sensor, and of sensors worse than specified."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.contradictions import coarser
from cjt_gym.gap.check.drive import LATEST, LEAST_DELAY
from cjt_gym.gap.check.friction import TURN, one_way, seen, two_ways
from cjt_gym.gap.check.pieces import Columns
from cjt_gym.gap.check.transmission import BESIDE, no_spring, spring
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, only_from
from cjt_gym.gap.check.view import View
from cjt_gym.joint.kernel.arrays import Floats

GAIN = 0.3
"""Upper limit on the smallest identifiable gain error."""
STEPS = 8.0
"""Least range of a channel, in steps of its resolution."""
MEASURED = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def torque_gain(view: View) -> Verdict:
    """Judge the sensor's scale, which requires a sufficient deflection of the spring."""
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance.y, ("rate", "one"))
    if size <= GAIN:
        return Seen(size, "-")
    return Unseen(only_from(size, "-"), "Load the spring further.")


def torque_bias(view: View) -> Verdict:
    """Judge the sensor's zero, which requires motion in both directions."""
    if "tau" not in view:
        return Unseen("no joint torque tau is recorded that changes", BESIDE)
    balance = view.motor if view.cut else view.load
    if balance is None:
        return Unseen("no motion is recorded beside the joint torque", BESIDE)
    if not two_ways(view):
        return Unseen(
            f"{one_way(view)}: the sensor's zero cannot be told from Coulomb friction", TURN
        )
    return seen(view, balance, balance["one"], ("a", "v", "s"), view.torque_unit, TURN)


def torque_delay(view: View) -> Verdict:
    """Judge a delayed sensor, which requires a rapidly changing torque."""
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance["rise"], ("delta", "one"))
    if view.motor is not None and "i" in view:
        size = min(size, view.motor.least(view.at_motion(_rise), ("a", "v", "s", "one")))
    if size <= LATEST:
        return Seen(max(size, LEAST_DELAY * view.dt), "s")
    why = f"the torque changes so slowly that {only_from(1e3 * size, 'ms')}"
    return Unseen(why, "Record quick steps of the current.")


def _rise(piece: Columns) -> Floats:
    return np.asarray(np.gradient(piece["tau"], float(piece["t"][1] - piece["t"][0])))


def noise(view: View) -> Verdict:
    """Judge excess noise, which requires a specification."""
    stated = [view.channels[n] for n in MEASURED if n in view and view.channels[n].specified > 0.0]
    if not stated:
        why = "the joint file specifies neither noise nor resolution of any channel recorded"
        return Unseen(why, "State them: [sensors.q_m] noise and resolution.")
    best = min(stated, key=lambda channel: channel.specified / channel.span)
    return Seen(2.0 * best.specified, best.unit)


def quantization(view: View) -> Verdict:
    """Judge a coarse channel, which requires a stated resolution and motion over many steps."""
    if view.joint is None:
        return Unseen("no joint file states a resolution", "State it: [sensors.q_m] resolution.")
    sensors = view.joint.sensors
    stated = [
        n
        for n in MEASURED
        if n in view and "resolution" in sensors.get(n, {}) and view.channels[n].resolution > 0.0
    ]
    if not stated:
        why = "the joint file states no resolution of any channel recorded"
        return Unseen(why, "State it: [sensors.q_m] resolution.")
    if wrong := coarser(view):
        return Unseen(wrong[0].rstrip("."), "Map each channel with its unit and side: --mapping.")
    known = [view.channels[name] for name in stated]
    best = max(known, key=lambda channel: channel.span / channel.resolution)
    steps = best.span / best.resolution
    if steps >= STEPS:
        return Seen(2.0 * best.resolution, best.unit)
    return Unseen(
        f"{best.name} moves by {steps:.2g} steps of its resolution", "Record more motion."
    )
