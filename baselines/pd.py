"""PD control of the joint torque, without feed-forward.

    u = kp e + kd F e_d,   e = r - tau,   e_d = e or, without lead, -tau

F is the filtered derivative of `FilteredDerivative`, cut off at 200 Hz. Without feed-forward or
integral it leaves an error of 1 / (1 + kp): it shows what feed-forward is worth.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import damping_gains
from cjt_gym.baselines.plant_model import SampledJoint


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    kp = (0.01, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0)
    return grid(kp=kp, kd=damping_gains(model, (0.0, 0.05, 0.1, 0.2, 0.3, 0.5)))


ROW = composed_row(
    "pd",
    "pd",
    summary="PD on the torque error without feed-forward, derivative filtered at 200 Hz.",
    source="Readman (1994), Flexible Joint Robots, CRC Press",
    candidates=_candidates,
)
