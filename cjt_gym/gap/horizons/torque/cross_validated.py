"""What a torque is spent on: an effect that a regression shows, cross-validated over stretches."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cjt_gym.joint.kernel.arrays import Floats

BLOCKS = 12
"""Number of stretches of a record, each predicted from the others."""
SHORTEST = 10
"""Fewest samples of such a stretch."""
SPENT, CLEAR = 0.15, 3.0
"""Least share of the error that an effect must remove from a regression, and least reduction in
standard deviations over the stretches, to be detected."""


@dataclass(frozen=True)
class Spent:
    """An effect on which a torque is spent.

    Attributes:
        name: The effect.
        values: Its coefficients.
        deviations: Their standard deviations, from regressions without one stretch each.
        share: Share of the squared error on predicted stretches that it removes.
    """

    name: str
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    share: float

    @property
    def size(self) -> float:
        """Size of its coefficients, of which cogging has two beside its frequency."""
        return float(np.hypot.reduce(self.values[-2:]))


def predicted(columns: Floats, torque: Floats) -> tuple[Floats, Floats]:
    """Return the mean square error of each stretch, and the fits without it, one per row.

    Args:
        columns: Regressors, shape (M, K).
        torque: What they explain, shape (M,).
    """
    edges = -(-np.arange(BLOCKS + 1) * len(torque) // BLOCKS)
    blocks = [slice(*pair) for pair in pairwise(edges)]
    reduced = [np.linalg.qr(np.column_stack([columns[b], torque[b]]), "r") for b in blocks]
    alike = float(np.finfo(np.float64).eps) * len(torque)  # as of all rows at once
    errors, fits = [], []
    for k, block in enumerate(blocks):
        other = np.concatenate([r for m, r in enumerate(reduced) if m != k])
        fit = np.linalg.lstsq(other[:, :-1], other[:, -1], rcond=alike)[0]
        errors.append(np.mean((torque[block] - columns[block] @ fit) ** 2))
        fits.append(fit)
    return np.array(errors), np.array(fits)


def deviations(fits: Floats) -> Floats:
    """Return the standard deviations of coefficients from fits without one stretch each."""
    return np.asarray(np.std(fits, axis=0) * np.sqrt(len(fits) - 1))


def gain(full: Floats, less: Floats) -> tuple[float, float]:
    """Return the share of the error that is removed, and the reduction in standard deviations."""
    gains = less - full
    deviation = max(float(np.std(gains, ddof=1)) * np.sqrt(len(gains)), 1e-300)
    return float(1.0 - full.sum() / max(less.sum(), 1e-300)), float(gains.sum()) / deviation


def steady_gain(full: Floats, less: Floats) -> float:
    """Return the mean relative reduction of the error in standard deviations over the stretches.

    Unlike that of `gain` it is not blurred where stretches differ in how much there is to reduce.
    """
    gains = np.log(np.maximum(less, 1e-300) / np.maximum(full, 1e-300))
    deviation = max(float(np.std(gains, ddof=1)) * np.sqrt(len(gains)), 1e-300)
    return float(gains.sum() / deviation)
