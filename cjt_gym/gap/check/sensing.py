"""What a record shows of the torque sensor, and of sensors that are worse than specified."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.friction import TURN, one_way, seen, two_ways
from cjt_gym.gap.check.transmission import BESIDE, no_spring, spring
from cjt_gym.gap.check.verdicts import Seen, Unseen, Verdict, only_from
from cjt_gym.gap.check.view import View

GAIN = 0.3
"""Relative size up to which the least one may come."""
LATEST = 0.03
"""Delay up to which the least one may come [s]."""
LEAST_DELAY = 0.25
"""Share of a sample below which no delay can be told."""
STEPS = 8.0
"""Steps of its resolution over which a channel must move."""
MEASURED = ("i", "q_m", "q_g", "q_l", "dq_m", "dq_g", "dq_l", "tau")


def torque_gain(view: View) -> Verdict:
    """The sensor's scale is told from the motor's by the spring's deflection."""
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance.y, ("rate", "one"))
    if size <= GAIN:
        return Seen(size, "-")
    return Unseen(only_from(size, "-"), "Load the spring further.")


def torque_bias(view: View) -> Verdict:
    """The sensor's zero needs motion in both directions, or rest."""
    if "tau" not in view:
        return Unseen("no joint torque tau is recorded that changes", BESIDE)
    balance = view.motor if view.cut else view.load
    if balance is None:
        return Unseen("no motion is recorded beside the joint torque", BESIDE)
    if not two_ways(view):
        return Unseen(f"{one_way(view)}: the sensor's zero is one with Coulomb friction", TURN)
    return seen(view, balance, balance["one"], ("a", "v", "s"), view.torque_unit, TURN)


def torque_delay(view: View) -> Verdict:
    """A late sensor needs a torque that changes fast."""
    if (none := no_spring(view)) is not None:
        return none
    balance = spring(view)
    size = balance.least(balance["rise"], ("delta", "one"))
    if view.motor is not None and "i" in view:
        size = min(size, view.motor.least(_rise(view), ("a", "v", "s", "one")))
    if size <= LATEST:
        return Seen(max(size, LEAST_DELAY * view.dt), "s")
    why = f"the torque changes so slowly that {only_from(1e3 * size, 'ms')}"
    return Unseen(why, "Record quick steps of the current.")


def _rise(view: View):  # type: ignore[no-untyped-def]
    balance = view.motor
    assert balance is not None
    rise = np.zeros(len(balance))
    for k, piece in enumerate(view.stretches):
        own = balance["stretch"] == k
        slope = np.gradient(piece["tau"], view.dt)
        rise[own] = np.interp(balance["time"][own], piece["t"], slope)
    return rise


def noise(view: View) -> Verdict:
    """A noise beyond the specified needs a specification."""
    stated = [view.channels[n] for n in MEASURED if n in view and view.channels[n].specified > 0.0]
    if not stated:
        why = "the joint file specifies neither noise nor resolution of any channel recorded"
        return Unseen(why, "State them: [sensors.q_m] noise and resolution.")
    best = min(stated, key=lambda channel: channel.specified / channel.span)
    return Seen(2.0 * best.specified, best.unit)


def quantization(view: View) -> Verdict:
    """A coarse channel needs a stated resolution, and motion over many steps."""
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
    known = [view.channels[name] for name in stated]
    best = max(known, key=lambda channel: channel.span / channel.resolution)
    steps = best.span / best.resolution
    if steps >= STEPS:
        return Seen(2.0 * best.resolution, best.unit)
    return Unseen(
        f"{best.name} moves by {steps:.2g} steps of its resolution", "Record more motion."
    )
