"""Torque ripple: Fourier series in the motor angle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.compiled import compiled

FREQUENCY, COSINE, SINE, KIND = 0, 1, 2, 3
ADDITIVE, PROPORTIONAL = 0.0, 1.0


@compiled
def ripple_torque(
    table: NDArray[np.float64],
    q_m: float,
    tau: float,
    cogging_scale: float,
    gear_scale: float,
) -> float:
    """Return the ripple torque that is added to the motor torque [N m].

        sum_j (a_j cos(f_j q) + b_j sin(f_j q)) * (1 or tau)

    The spatial frequency counts periods per revolution of q_m, which is the rotor angle
    divided by n: f = n k for the k-th harmonic of the rotor.

    Args:
        table: Rows [f, a, b, kind], shape (rows, 4); kind 0 adds N m, kind 1 is a share of
            the transmitted torque.
        q_m: Motor angle on the link side [rad].
        tau: Transmitted torque [N m].
        cogging_scale: Factor on the rows of kind 0.
        gear_scale: Factor on the rows of kind 1.
    """
    total = 0.0
    for j in range(table.shape[0]):
        angle = table[j, FREQUENCY] * q_m
        value = table[j, COSINE] * math.cos(angle) + table[j, SINE] * math.sin(angle)
        if table[j, KIND] == PROPORTIONAL:
            value *= tau * gear_scale
        else:
            value *= cogging_scale
        total += value
    return total
