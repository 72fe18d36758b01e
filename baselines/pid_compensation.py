"""PID control of the joint torque with compensation of the torque.

    u = tau + kp e + ki integral of e + kd F e_d,   e = r - tau,
    e_d = -tau or, with lead, e

The torque that the spring exerts on the motor is added back, so that the PID acts on the motor's
bare mass and kp takes the part of the spring.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import INTEGRALS, KD, KI, KP, LATE, damping_gains
from cjt_gym.baselines.plant_model import SampledJoint


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    damping = damping_gains(model, (0.0, 0.05, 0.1, 0.2, 0.3, 0.5))
    return grid(kp=(0.5, 0.7, 1.0, 1.2, 1.5, 2.0), ki=INTEGRALS, kd=damping)


ROW = composed_row(
    "pid_compensation",
    "pid+torque",
    summary="Compensation of the measured torque and PID on the torque error.",
    source="Readman (1994), Flexible Joint Robots, CRC Press",
    tunable=(KP, KI, KD, LATE),
    candidates=_candidates,
)
