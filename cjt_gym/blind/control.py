"""The controller of a run: feedforward, and PI or PD on the measured torque."""

from __future__ import annotations

import math
from typing import NamedTuple

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.plant import Floats


class Gains(NamedTuple):
    """Gains of i = (ff tau_ref + kp e + ki int e - kd dtau/dt) per_ampere.

    Attributes:
        closed: 1 for a closed loop; 0 passes the reference on as the command [A].
        per_ampere: Current per torque, 1 / (k_t n) of the datasheet [A/(N m)].
        limit: Largest command [A].
        ff: Feedforward of the reference [-].
        kp: Proportional gain [-].
        ki: Integral gain [1/s].
        kd: Gain of the filtered rate of the torque [s].
        smooth: Share of the old value in the filter of the rate [-].
        dt: Time between samples [s].
    """

    closed: float = 0.0
    per_ampere: float = 1.0
    limit: float = math.inf
    ff: float = 1.0
    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    smooth: float = 0.5
    dt: float = 1e-3


@jit
def decide(g: Gains, memory: Floats, reference: Floats, k: int, tau: float) -> float:
    """Return the command at sample k [A].

    Args:
        g: Gains.
        memory: Integral, last torque, filtered rate; shape (3,), in place.
        reference: Reference of the torque [N m] or, in an open loop, the current [A].
        k: Sample.
        tau: Measured torque [N m].
    """
    if g.closed == 0.0:
        return float(min(max(reference[k], -g.limit), g.limit))
    error = reference[k] - tau
    rate = (tau - memory[1]) / g.dt if k > 0 else 0.0
    memory[1] = tau
    memory[2] = g.smooth * memory[2] + (1.0 - g.smooth) * rate
    wanted = g.ff * reference[k] + g.kp * error + g.ki * memory[0] - g.kd * memory[2]
    command = min(max(wanted * g.per_ampere, -g.limit), g.limit)
    if command == wanted * g.per_ampere:
        memory[0] += error * g.dt
    return float(command)
