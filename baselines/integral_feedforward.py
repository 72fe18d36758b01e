"""Integral control of the joint torque with feed-forward.

    u = r + I,   I[k+1] = I[k] + dt ki (r[k] - tau[k])

Disturbances at the motor are rejected up to about ki / (2 pi) Hz; the joint's own resonance is
left as it is, and limits ki.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.linear_row import grid

ROW = composed_row(
    "integral_feedforward",
    "reference+i",
    summary="Feed-forward and integral of the torque error.",
    source="Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4)",
    candidates=lambda model: grid(ki=np.geomspace(0.1, 100.0, 31).tolist()),
)
