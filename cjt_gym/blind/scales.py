"""Magnitudes of a joint's signals, to which the sizes of effects are relative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.blind.plant import Floats, World
from cjt_gym.blind.run import Run
from cjt_gym.blind.state import CURRENT, Q, V


@dataclass(frozen=True)
class Scales:
    """Sizes of the signals of a joint without effects."""

    current: float  # root mean square of the current [A]
    peak: float  # largest command [A]
    motor_torque: float  # root mean square of the motor torque [N m]
    joint_torque: float  # root mean square of the joint torque [N m]
    # root mean square of the velocities of motor, gear and load [rad/s]
    speed: tuple[float, float, float]
    travel: float  # distance between the extreme angles of the motor [rad]
    path: float  # mean absolute velocity of the motor [rad/s]
    twist: float  # root mean square of the joint torque over the softest spring's stiffness [rad]
    bend: float  # 98th percentile of the twist of the bar [rad]


def scales_of(world: World, run: Run) -> Scales:
    """Return the sizes of the signals of a run."""
    p, x = world.plant, run.states
    current, tau = _rms(x[:, CURRENT]), _rms(run.clean[:, 4])
    q_m, speed = x[:, Q], [_rms(x[:, V + body]) for body in range(3)]
    spring = p.k_g if world.structure.gear_is_soft else p.k_b
    return Scales(
        current=current,
        peak=float(np.abs(run.command).max()),
        motor_torque=p.k_t * p.n * current,
        joint_torque=tau,
        speed=(speed[0], speed[1], speed[2]),
        travel=float(np.ptp(q_m)),
        path=float(np.abs(x[:, V]).mean()),
        twist=tau / spring,
        bend=float(np.percentile(np.abs(run.clean[:, 4]), 98)) / p.k_b,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
