"""PID control of the joint torque with feed-forward.

    u = r + kp e + ki integral of e + kd F e_d,   e = r - tau,   e_d = e or, without lead, -tau

in parallel form, with the filtered derivative F of `FilteredDerivative` at 200 Hz.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import INTEGRALS, damping_gains
from cjt_gym.baselines.plant_model import SampledJoint


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    damping = damping_gains(model, (0.0, 0.05, 0.1, 0.2, 0.3, 0.5))
    return grid(kp=(0.0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5), ki=INTEGRALS, kd=damping)


ROW = composed_row(
    "pid_feedforward",
    "pid+reference",
    summary="Feed-forward and PID on the torque error.",
    source="Readman (1994), Flexible Joint Robots, CRC Press; Vischer, Khatib (1995), IEEE "
    "Transactions on Robotics and Automation 11(4)",
    candidates=_candidates,
)
