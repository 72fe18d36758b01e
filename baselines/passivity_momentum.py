"""Passivity-based torque control with compensation of friction by a momentum observer.

    u = r + (B / B_d - 1) (r - tau) - (B / B_d) D_s (dq_m - dq_l) + d

The first part is `cjt_gym.baselines.passivity`; d is the torque that opposes the motor, from the
generalised-momentum observer.
"""

from __future__ import annotations

from cjt_gym.baselines.entry import SPRUNG, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.passivity import passivity_block
from cjt_gym.baselines.pid import damper
from cjt_gym.baselines.plant_model import SampledJoint


def passivity_momentum_law(
    model: SampledJoint, shaping: float, damping: float, bandwidth_hz: float
) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    friction = momentum_observer(model, bandwidth_hz).block(disturbance=1.0)
    return assemble(model.dt, passivity_block(shaping, damping), friction)


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    return grid(
        shaping=(1.0, 1.2, 1.5, 2.0, 3.0),
        damping=damper(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5)),
        bandwidth_hz=(0.02, 0.2, 1.0, 2.0, 4.0, 8.0, 12.0, 18.0, 25.0, 35.0, 50.0),
    )


ROW = linear_row(
    name="passivity_momentum",
    summary="Passivity-based, with friction from a generalised-momentum observer.",
    source="Albu-Schaeffer, Ott, Hirzinger (2007), International Journal of Robotics Research "
    "26(1); Le Tien, Albu-Schaeffer, De Luca, Hirzinger (2008), IROS",
    tunable=(
        Gain("shaping", "-", 1.0, 10.0),
        Gain("damping", "N m s/rad", 0.0, 1000.0),
        Gain("bandwidth_hz", "Hz", 0.001, 200.0, log=True),
    ),
    law=passivity_momentum_law,
    candidates=_candidates,
    structures=SPRUNG,
)
