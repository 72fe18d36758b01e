"""The torque of the torsion bar from its deflection, with all that may be wrong with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.fields import Fields
from cjt_gym.joint.compiled import compiled

Floats = NDArray[np.float64]


def spring_torque(fields: Fields, deflection: Floats, dt: float) -> Floats:
    """Return the torque of the bar [N m], shape (N,).

        tau = k_b x (1 + hard x^2) + d_gl dx/dt + hyst z(x),   x the deflection less the play

    Args:
        fields: The model.
        deflection: Of the bar [rad], shape (N,).
        dt: Sample time [s].
    """
    x = deflection
    if fields["play"] > 0.0:
        half = 0.5 * fields["play"]
        x = x - np.clip(x, -half, half)
    torque = fields["k_b"] * x
    if fields["hard"] != 0.0:
        torque = torque * (1.0 + fields["hard"] * x * x)
    if fields["d_gl"] != 0.0:
        torque = torque + fields["d_gl"] * np.gradient(x, dt)
    if fields["hyst"] != 0.0:
        torque = torque + fields["hyst"] * slip(np.diff(x, prepend=x[0]), fields["hyst_z"])
    return np.asarray(torque)


@compiled
def slip(steps: Floats, width: float) -> Floats:
    """Return the state of a hysteresis in [-1, 1] that follows increments of deflection.

    dz = dx (1 - z sign(dx)) / width, solved exactly for each increment.

    Args:
        steps: Increments [rad], shape (N,).
        width: Deflection over which it turns round [rad].
    """
    z = np.zeros(steps.size)
    state = 0.0
    for t in range(steps.size):
        side = 1.0 if steps[t] >= 0.0 else -1.0
        state = side + (state - side) * np.exp(-abs(steps[t]) / width)
        z[t] = state
    return z
