"""A torque that repeats with the motor's angle, read off a regression of the torque.

A search over horizons cannot find its frequency: away from it no prediction improves. The spectrum
over the angle of what inertia, friction and weight leave of the torque shows it at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, savgol_filter

from cjt_gym.gap.horizons.log import LEAST_SMOOTH, Log
from cjt_gym.gap.horizons.spent import (
    BLOCKS,
    CLEAR,
    SHORTEST,
    SPENT,
    STUCK,
    Spent,
    deviations,
    gain,
    predicted,
    steady_gain,
)
from cjt_gym.joint import Joint

Floats = NDArray[np.float64]
OVER = 0.01
"""Time over which the motion is smoothed [s]."""
PERIODS, SAMPLES = 3.0, 4.0
"""Fewest periods within the travel, and fewest samples within a period at the usual speed."""
PEAKS, STEPS = 5, 15
"""Number of peaks that are tried, and of frequencies around each."""
CELLS = 1 << 20
"""Largest number of cells over the travel."""


def over_angle(joint: Joint, logs: Sequence[Log]) -> Spent | None:
    """Return the strongest cogging that clearly takes torque, None if there is none.

    Its values are the frequency [rad/rad] and the amplitudes of cosine and sine [N m], as in the
    effect table; it must reduce the error on stretches that are not regressed.

    Args:
        joint: The nominal joint.
        logs: The records.
    """
    parts = [_moving(joint, log) for log in logs if "q_m" in log.measured and not log.voltage]
    if joint.structure_row.has_spring or not parts:
        return None
    q, moved, columns, torque = (np.concatenate(some) for some in zip(*parts, strict=True))
    if len(q) < BLOCKS * SHORTEST:
        return None
    known = np.linalg.qr(columns)[0]
    left = torque - known @ (known.T @ torque)
    low, high = 2.0 * np.pi * PERIODS / max(np.ptp(q), 1e-12), 2.0 * np.pi / SAMPLES

    def explained(f: float) -> float:
        """Return how little the rest of the torque leaves of a wave, as minus a sum of squares."""
        waves = np.column_stack([np.cos(f * q), np.sin(f * q)])
        waves -= known @ (known.T @ waves)
        return -float(np.linalg.lstsq(waves, left, rcond=None)[1].sum())

    tried = _frequencies(q, left, low, high / max(float(np.median(moved)), 1e-12))
    near = np.linspace(-1.0, 1.0, STEPS) * np.pi / max(np.ptp(q), 1e-12)
    refined = [max(one + near, key=explained) for one in tried]
    if not refined:
        return None
    f = float(max(refined, key=explained))
    full = np.column_stack([columns, np.cos(f * q), np.sin(f * q)])
    (errors, fits), (less, _) = predicted(full, torque), predicted(columns, torque)
    share, clear = gain(errors, less)
    if share < SPENT or max(clear, steady_gain(errors, less)) < CLEAR:
        return None
    waves = -fits[:, -2:]  # the motor's torque balances that of the magnets
    a, b = waves.mean(axis=0)
    cell = np.pi / max(float(np.ptp(q)), 1e-12) / STEPS
    return Spent("cogging", (f, float(a), float(b)), (cell, *deviations(waves).tolist()), share)


def _moving(joint: Joint, log: Log) -> tuple[Floats, Floats, Floats, Floats]:
    """Return angle, its change per sample, regressors and torque where a joint moves."""
    count = min(max(LEAST_SMOOTH, round(OVER / log.dt)) | 1, (len(log) - 1) | 1)
    q, v, a = (
        savgol_filter(log.measured["q_m"], count, 2, deriv=k, delta=log.dt) for k in range(3)
    )
    use = log.inside & (np.abs(v) > STUCK * float(np.sqrt(np.mean(v[log.inside] ** 2))))
    columns = np.stack([a, v, np.sign(v), np.ones_like(v), np.cos(q), np.sin(q)], axis=1)
    torque = joint.parameters.k_t * joint.parameters.n * log.command + log.load
    return q[use], np.abs(v[use]) * log.dt, columns[use], torque[use]


def _frequencies(q: Floats, left: Floats, low: float, high: float) -> list[float]:
    """Return the frequencies of the highest peaks of a spectrum over the angle [rad/rad]."""
    travel = float(np.ptp(q))
    cell = max(2.0 * np.pi / high / 6.0, travel / CELLS * 4.0)
    index = ((q - q.min()) / cell).astype(np.int64)
    size = int(2 ** np.ceil(np.log2(index.max() + 2))) * 4
    power = np.abs(np.fft.rfft(np.bincount(index, weights=left, minlength=size))) ** 2
    f = 2.0 * np.pi * np.arange(power.size) / (size * cell)
    power[(f < low) | (f > high)] = 0.0
    peaks, _ = find_peaks(power)
    return [float(one) for one in f[peaks[np.argsort(power[peaks])[::-1][:PEAKS]]]]
