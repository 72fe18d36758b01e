"""The torque of the torsion bar from its deflection, including all its possible defects."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve1d
from scipy.signal import savgol_coeffs

from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import compiled

MOST_PIECES = 50.0
PATH = savgol_coeffs(17, 3)
"""Weights that smooth the path of a hysteresis, over 17 samples."""


def spring_torque(
    fields: Fields, deflection: Floats, dt: float, slack: Floats | None = None
) -> Floats:
    """Return the torque of the bar [N m], shape (N,).

        tau = k_b x (1 + hard x^2) + d_gl dx/dt + hyst z(x),   x the deflection less the play

    Args:
        fields: The model.
        deflection: Of the bar [rad], shape (N,).
        dt: Sample time [s].
        slack: Width of play in addition to the model's [rad], shape (N,).
    """
    x = deflection
    if fields["play"] > 0.0 or slack is not None:
        width = fields["play"] + (0.0 if slack is None else slack)
        half = 0.5 * np.maximum(width, 0.0)
        x = x - np.clip(x, -half, half)
    torque = fields["k_b"] * x
    if fields["hard"] != 0.0:
        torque = torque * (1.0 + fields["hard"] * x * x)
    if fields["d_gl"] != 0.0:
        torque = torque + fields["d_gl"] * np.gradient(x, dt)
    if fields["hyst"] != 0.0:
        # Noise in the path would erode the memory: while it yields, forward and back steps differ.
        path = convolve1d(x, PATH, mode="nearest")
        torque = torque + fields["hyst"] * slip(path, fields["hyst_z"], fields["hyst_n"])
    return np.asarray(torque)


@compiled
def slip(path: Floats, width: float, exponent: float) -> Floats:
    """Return the state of a hysteresis in [-1, 1] that follows a path.

    Bouc-Wen: dz = dx (1 - |z|^exponent (1 + sign(z dx)) / 2) / width. Exponent 0 stands for Maxwell
    slip: dz = dx / width, held within [-1, 1].

    Args:
        path: Deflection without noise [rad], shape (N,).
        width: Deflection over which it reverses [rad].
        exponent: How sharply it yields.
    """
    z = np.zeros(path.size)
    state = 0.0
    for t in range(1, path.size):
        move = (path[t] - path[t - 1]) / width
        if exponent > 0.0:
            pieces = 1 + int(min(abs(move) / 0.05, MOST_PIECES))
            for _ in range(pieces):
                middle = state + 0.5 * yielding(state, move / pieces, exponent)
                state += yielding(middle, move / pieces, exponent)
        else:
            state = min(max(state + move, -1.0), 1.0)
        z[t] = state
    return z


@compiled
def yielding(z: float, move: float, exponent: float) -> float:
    """Return the change of a Bouc-Wen state over a move in units of its width."""
    if z * move <= 0.0:
        return move
    return float(move * (1.0 - min(abs(z), 1.0) ** exponent))
