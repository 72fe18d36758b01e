"""Integral control of the joint torque with feed-forward.

    u = r + I,   I[k+1] = I[k] + dt ki (r[k] - tau[k])

Disturbances at the motor are rejected up to about ki / (2 pi) Hz; the joint's own resonance is
left as it is, and limits ki.
"""

from __future__ import annotations

import numpy as np

from cjt_gym.baselines.entry import FIXED, ZERO_AT_REST
from cjt_gym.baselines.linear_law import LinearLaw, assemble, integrator, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import KI
from cjt_gym.baselines.plant_model import SampledJoint


def integral_law(model: SampledJoint, ki: float) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    integral = integrator(ki, model.dt, 1.0, reference=1.0, tau=-1.0)
    return assemble(model.dt, static(reference=1.0), integral)


ROW = linear_row(
    name="integral_feedforward",
    summary="Feed-forward and integral of the torque error.",
    source="Vischer, Khatib (1995), IEEE Transactions on Robotics and Automation 11(4)",
    tunable=(KI,),
    law=integral_law,
    candidates=lambda model: grid(ki=np.geomspace(0.1, 100.0, 31).tolist()),
    structures=FIXED,
    refusal=ZERO_AT_REST,
)
