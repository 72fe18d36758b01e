"""Feed-forward of the reference and of the friction that a momentum observer finds.

    u = r + d

d is the torque that opposes the motor, friction above all, from the generalised-momentum observer
(`cjt_gym.baselines.observers.momentum`). The joint is left as it is, without its friction: with
its resonance, and with the damping that the observer's lag takes from it.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.entry import SPRUNG, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.observers.momentum import momentum_observer
from cjt_gym.baselines.plant_model import SampledJoint


def momentum_dob_law(model: SampledJoint, bandwidth_hz: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    friction = momentum_observer(model, bandwidth_hz).block(disturbance=1.0)
    return assemble(model.dt, static(reference=1.0), friction)


ROW = linear_row(
    name="momentum_dob",
    summary="Feed-forward, and friction from a generalised-momentum observer.",
    source="Le Tien, Albu-Schaeffer, De Luca, Hirzinger (2008), IROS",
    tunable=(Gain("bandwidth_hz", "Hz", 0.001, 200.0, log=True),),
    law=momentum_dob_law,
    candidates=lambda model: grid(bandwidth_hz=np.geomspace(0.01, 100.0, 33).tolist()),
    structures=SPRUNG,
)
