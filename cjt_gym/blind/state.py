"""Layout of the state of one joint: positions, velocities and memories."""

from __future__ import annotations

from typing import Final

import numpy as np

from cjt_gym.blind.plant import Floats, World

Q: Final = 0  # positions of motor, gear, load, mount [rad]
V: Final = 4  # their velocities [rad/s]
CURRENT: Final = 8  # motor current [A]
SLEWED: Final = 9  # reference of the current loop after the slew limit [A]
HEAT: Final = 10  # low-passed square of the current [A^2]
WARM: Final = 11  # progress of warming up [-]
CREEP: Final = 12  # crept deflection of the bar [rad]
BRISTLE: Final = 13  # deflection of the bristles of motor, gear, load [rad]
SLIP: Final = 16  # deflections of the slip elements of the bar [rad]
SLIPS: Final = 3
WEN: Final = 19  # Bouc-Wen deflection of the bar [rad]
BAR: Final = 20  # deflection of the bar at which the memories stand [rad]
PLACE: Final = 21  # positions of motor, gear, load at which the bristles stand [rad]
TAU: Final = 24  # torque transmitted by a rigid joint [N m]
SIZE: Final = 25


def initial_state(world: World) -> Floats:
    """Return the state at the first sample, shape (SIZE,): at rest by default.

    `world.start` may hold "v" [rad/s] of all bodies, "twist" [rad], a lead of motor and gear over
    the load, and "wind" [rad], a lead of the motor over the gear.
    """
    x = np.zeros(SIZE)
    start = world.start
    twist = start.get("twist", 0.0) if world.structure.bar_is_soft else 0.0
    x[Q : Q + 2] += twist
    x[Q] += start.get("wind", 0.0) if world.structure.gear_is_soft else 0.0
    if not world.structure.is_locked:
        x[V : V + 4] = start.get("v", 0.0)
    x[PLACE : PLACE + 3] = x[Q : Q + 3]
    return x
