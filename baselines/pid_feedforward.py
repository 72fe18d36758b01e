"""PID control of the joint torque with feed-forward.

    u = r + kp e + ki integral of e + kd F e_d,   e = r - tau,   e_d = e or, without lead, -tau

in parallel form, with the filtered derivative F of `FilteredDerivative` at 200 Hz.
"""

from __future__ import annotations

from cjt_gym.baselines.entry import FIXED, ZERO_AT_REST
from cjt_gym.baselines.linear_law import LinearLaw, assemble
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import INTEGRALS, KD, KI, KP, LEAD, damping_gains, pid
from cjt_gym.baselines.plant_model import SampledJoint


def pid_feedforward_law(
    model: SampledJoint, kp: float, ki: float, kd: float, lead: float = 1.0
) -> LinearLaw:
    """Return the law; see the module, and `cjt_gym.baselines.pid` for its gains."""
    return assemble(model.dt, pid(kp, ki, kd, model.dt, lead, forward=1.0))


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    damping = damping_gains(model, (0.0, 0.05, 0.1, 0.2, 0.3, 0.5))
    return grid(kp=(0.0, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5), ki=INTEGRALS, kd=damping)


ROW = linear_row(
    name="pid_feedforward",
    summary="Feed-forward and PID on the torque error.",
    source="Readman (1994), Flexible Joint Robots, CRC Press; Vischer, Khatib (1995), IEEE "
    "Transactions on Robotics and Automation 11(4)",
    tunable=(KP, KI, KD, LEAD),
    law=pid_feedforward_law,
    candidates=_candidates,
    structures=FIXED,
    refusal=ZERO_AT_REST,
)
