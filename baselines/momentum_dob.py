"""Feed-forward of the reference and of the friction that a momentum observer finds.

    u = r + d

d is the torque that opposes the motor, friction above all, from the generalised-momentum observer
(`cjt_gym.baselines.observers.momentum`). The joint is left as it is, without its friction: with
its resonance, and with the damping that the observer's lag takes from it.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid

ROW = composed_row(
    "momentum_dob",
    "reference+momentum_dob",
    summary="Feed-forward, and friction from a generalised-momentum observer.",
    source="Le Tien, Albu-Schaeffer, De Luca, Hirzinger (2008), IROS",
    candidates=lambda model: grid(bandwidth_hz=np.geomspace(0.01, 100.0, 33).tolist()),
)
