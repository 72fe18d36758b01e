"""Where a search may start: a regression of the motor's torque on what it has to move.

A search that begins with too heavy a joint may never leave it: such a joint hardly listens to its
torque, so that no further effect changes much. Inverse dynamics err to the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from cjt_gym.gap.horizons.log import LEAST_SMOOTH, Log
from cjt_gym.joint import Joint

Floats = NDArray[np.float64]
OVER = 0.1
"""Time over which torque and motion are smoothed [s]."""
STUCK = 0.05
"""Share of the usual speed below which dry friction says nothing."""
FEWEST = 50
"""Fewest samples of motion."""
PLACES = {"coulomb": (2,), "torque_offset": (3,), "gravity": (4, 5)}
"""Columns of the regressors that stand for an effect."""
SETS = (("coulomb",), ("coulomb", "torque_offset"), ("coulomb", "gravity"))
"""Effects of each start."""


@dataclass(frozen=True)
class Inverse:
    """What a regression finds.

    Attributes:
        inertia: Of all bodies that move with the motor [kg m^2].
        damping: The same [N m s/rad].
        effects: Values of the terms, by the name of the effect, dry friction first.
    """

    inertia: float
    damping: float
    effects: dict[str, tuple[float, ...]]


def inverse(joint: Joint, logs: Sequence[Log]) -> list[Inverse]:
    """Return a regression for each set of effects; none where the records do not allow it."""
    shape = joint.structure_row
    sprung = shape.groups[1] != shape.groups[2]
    usable = [x for x in logs if "q_m" in x.measured and not (sprung and "tau" not in x.measured)]
    if not usable or any(log.voltage for log in usable):
        return []
    parts = [_columns(joint, log, sprung) for log in usable]
    columns, torque = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    if len(torque) < FEWEST:
        return []
    found = []
    for effects in SETS:
        used = [0, 1, *(k for name in effects for k in PLACES[name])]
        values = np.linalg.lstsq(columns[:, used], torque, rcond=None)[0]
        value = dict(zip(used, values.tolist(), strict=True))
        own = {name: tuple(value[k] for k in PLACES[name]) for name in effects}
        found.append(Inverse(max(value[0], 0.0), max(value[1], 0.0), own))
    return found


def _columns(joint: Joint, log: Log, sprung: bool) -> tuple[Floats, Floats]:
    """Return the regressors where the joint moves, shape (M, 6), and the motor's torque, (M,)."""
    p = joint.parameters
    count = min(max(LEAST_SMOOTH, round(OVER / log.dt)) | 1, (len(log) - 1) | 1)
    torque = p.k_t * p.n * log.command
    torque = torque - log.measured["tau"] if sprung else torque + log.load
    q, v, a = (
        savgol_filter(log.measured["q_m"], count, 2, deriv=k, delta=log.dt) for k in range(3)
    )
    usual = STUCK * float(np.sqrt(np.mean(v[log.whole] ** 2)))
    use = log.whole & (np.abs(v) > usual)
    columns = np.stack([a, v, np.sign(v), -np.ones_like(v), np.cos(q), np.sin(q)], axis=1)
    return columns[use], savgol_filter(torque, count, 2)[use]
