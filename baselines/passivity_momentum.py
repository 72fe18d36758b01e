"""Passivity-based torque control with compensation of friction by a momentum observer.

    u = r + (B / B_d - 1) (r - tau) - (B / B_d) D_s (dq_m - dq_l) + d

The first part is `cjt_gym.baselines.passivity`; d is the torque that opposes the motor, from the
generalised-momentum observer.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import damper
from cjt_gym.baselines.plant_model import SampledJoint


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    return grid(
        shaping=(1.0, 1.2, 1.5, 2.0, 3.0),
        damping=damper(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5)),
        bandwidth_hz=(0.02, 0.2, 1.0, 2.0, 4.0, 8.0, 12.0, 18.0, 25.0, 35.0, 50.0),
    )


ROW = composed_row(
    "passivity_momentum",
    "passivity+momentum_dob",
    summary="Passivity-based, with friction from a generalised-momentum observer.",
    source="Albu-Schaeffer, Ott, Hirzinger (2007), International Journal of Robotics Research "
    "26(1); Le Tien, Albu-Schaeffer, De Luca, Hirzinger (2008), IROS",
    candidates=_candidates,
)
