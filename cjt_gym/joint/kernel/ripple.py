"""Torque ripple: Fourier series in the motor angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.compiled import lean

FREQUENCY, COSINE, SINE, KIND = 0, 1, 2, 3
COGGING, GEAR, COMMUTATION = 0.0, 1.0, 2.0
RIPPLES = {"cogging": COGGING, "gear_ripple": GEAR, "commutation_ripple": COMMUTATION}


def ripple_rows(effects: Mapping[str, Mapping[str, Any]]) -> NDArray[np.float64]:
    """Return the rows [f, a, b, kind] of all series among the effects, shape (rows, 4)."""
    rows: list[tuple[float, float, float, float]] = []
    for name, kind in RIPPLES.items():
        if name in effects:
            columns = [np.atleast_1d(effects[name][symbol]) for symbol in ("f", "a", "b")]
            rows += [(f, a, b, kind) for f, a, b in zip(*columns, strict=True)]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


@lean
def ripple_torque(
    p: Any, table: NDArray[np.float64], q_m: float, tau: float, k: float, current: float
) -> float:
    """Return the ripple torque that is added to the motor torque [N m].

        sum_j (a_j cos(f_j q) + b_j sin(f_j q)) * (1, tau or k i)

    with rows [f, a, b, kind] of the table: cogging adds N m, the others are shares of the
    transmitted torque or of the motor torque (see `RIPPLES`);
    and that of the current sensors' offsets. The spatial frequency counts periods per revolution
    of q_m [rad], which is the rotor angle divided by n: f = n k for the k-th harmonic of the rotor.
    """
    total = 0.0
    for j in range(table.shape[0]):
        angle = table[j, FREQUENCY] * q_m
        value = table[j, COSINE] * math.cos(angle) + table[j, SINE] * math.sin(angle)
        if table[j, KIND] == COGGING:
            total += value * p.cogging_scale
        elif table[j, KIND] == GEAR:
            total += value * p.gear_ripple_scale * tau
        else:
            total += value * p.commutation_scale * k * current
    if p.offset_a != 0.0 or p.offset_b != 0.0:
        angle = p.offset_p * p.n * q_m
        amperes = p.offset_a * math.cos(angle) + p.offset_b * math.sin(angle)
        total += k * amperes
    return total
