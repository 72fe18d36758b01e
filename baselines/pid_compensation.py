"""PID control of the joint torque with compensation of the torque.

    u = tau + kp e + ki integral of e + kd F e_d,   e = r - tau,
    e_d = -tau or, with lead, e

The torque that the spring exerts on the motor is added back, so that the PID acts on the motor's
bare mass and kp takes the part of the spring.
"""

from __future__ import annotations

from cjt_gym.baselines.entry import FIXED, ZERO_AT_REST, Gains
from cjt_gym.baselines.linear_law import LinearLaw, assemble, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import INTEGRALS, KD, KI, KP, LATE, damping_gains, leads, pid
from cjt_gym.baselines.plant_model import SampledJoint


def pid_compensation_law(
    kp: float, ki: float, kd: float, dt: float, lead: bool = False
) -> LinearLaw:
    """Return the law; see the module.

    Args:
        kp: Proportional gain [-].
        ki: Integral gain [1/s].
        kd: Derivative gain [s].
        dt: Sample time [s].
        lead: Whether the derivative is that of the error.
    """
    return assemble(dt, static(tau=1.0), pid(kp, ki, kd, dt, lead))


def _law(model: SampledJoint, gains: Gains) -> LinearLaw:
    return pid_compensation_law(gains["kp"], gains["ki"], gains["kd"], model.dt, leads(gains))


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    damping = damping_gains(model, (0.0, 0.05, 0.1, 0.2, 0.3, 0.5))
    return grid(kp=(0.5, 0.7, 1.0, 1.2, 1.5, 2.0), ki=INTEGRALS, kd=damping)


ROW = linear_row(
    name="pid_compensation",
    summary="Compensation of the measured torque and PID on the torque error.",
    source="Readman (1994), Flexible Joint Robots, CRC Press",
    tunable=(
        KP,
        KI,
        KD,
        LATE,
    ),
    law=_law,
    candidates=_candidates,
    structures=FIXED,
    refusal=ZERO_AT_REST,
)
