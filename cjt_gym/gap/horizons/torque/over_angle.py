"""A torque that repeats with the motor's angle, read off a regression of the torque.

A search over horizons cannot find its frequency: away from it no prediction improves. The spectrum
over the angle of what inertia, friction and weight leave of the torque shows it at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks, savgol_filter

from cjt_gym.gap.horizons.prediction.log import LEAST_SMOOTH, STUCK, Log
from cjt_gym.gap.horizons.torque.cross_validated import (
    BLOCKS,
    CLEAR,
    SHORTEST,
    Spent,
    deviations,
    gain,
    predicted,
    steady_gain,
)
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

OVER = (0.01, 0.02, 0.04)
"""Times over which motion and torque are smoothed [s]."""
LEAST, MOSTLY = 0.2, 0.5
"""Least share of the error that it must remove where motion is smoothed over the shortest time, and
over longer ones: there six real machines without known cogging have waves of 0.16 to 0.24."""
PERIODS, SAMPLES = 3.0, 4.0
"""Fewest periods within the travel, and fewest samples within a period at the usual speed."""
PEAKS, STEPS = 5, 15
"""Number of peaks that are tried, and of frequencies around each."""
SPREAD = 0.1
"""Relative deviation of a wave's amplitude that another method found."""
CELLS = 1 << 20
"""Largest number of cells over the travel."""


def over_angle(joint: Joint, logs: Sequence[Log]) -> Spent | None:
    """Return the strongest cogging that clearly takes torque, None if there is none.

    Its values are the frequency [rad/rad] and the amplitudes of cosine and sine [N m], as in the
    effect table; it must reduce the error on stretches that are not regressed. The motion is
    smoothed as long as the angle's resolution demands: of a short time the acceleration is noise,
    over a long one nothing is left of a wave.

    Args:
        joint: The nominal joint.
        logs: The records.
    """
    usable = [log for log in logs if "q_m" in log.measured and not log.voltage]
    if joint.structure_row.has_spring or not usable:
        return None
    found = [_smoothed_over(OVER[0], joint, usable, LEAST)]
    found += [_smoothed_over(time, joint, usable, MOSTLY) for time in OVER[1:]]
    return max((one for one in found if one is not None), key=lambda one: one.share, default=None)


def wave_of(found: Joint | None, nominal: Joint, logs: Sequence[Log]) -> Spent | None:
    """Return the cogging of a joint that was found, None if it is the nominal one's or none."""
    if found is None or "cogging" not in found.effects or "cogging" in nominal.effects:
        return None
    angles = [log.measured["q_m"] for log in logs if "q_m" in log.measured]
    if not angles:
        return None
    row = found.effects["cogging"]
    f, a, b = (float(np.atleast_1d(row[symbol])[0]) for symbol in ("f", "a", "b"))
    cell = np.pi / max(max(float(np.ptp(q)) for q in angles), 1e-12) / STEPS
    spread = SPREAD * float(np.hypot(a, b))
    return Spent("cogging", (f, a, b), (cell, spread, spread), 1.0)


def _smoothed_over(time: float, joint: Joint, logs: Sequence[Log], least: float) -> Spent | None:
    """Return the strongest cogging that clearly takes torque, with motion smoothed over a time.

    It must remove at least a share of the error.
    """
    parts = [_moving(joint, log, time) for log in logs]
    q, columns, torque = (np.concatenate([getattr(p, x) for p in parts]) for x in _Part.JOINED)
    if len(q) < BLOCKS * SHORTEST:
        return None
    step = float(np.median(np.concatenate([p.moved for p in parts])))
    known = np.linalg.qr(columns)[0]
    left = torque - known @ (known.T @ torque)
    low, high = 2.0 * np.pi * PERIODS / max(np.ptp(q), 1e-12), 2.0 * np.pi / SAMPLES

    def waves(f: float) -> Floats:
        """Return cosine and sine of a frequency, smoothed as the motion is, shape (M, 2)."""
        return np.concatenate([part.waves(f) for part in parts])

    def explained(f: float) -> float:
        """Return how little the rest of the torque leaves of a wave, as minus a sum of squares."""
        both = waves(f)
        both -= known @ (known.T @ both)
        return -float(np.linalg.lstsq(both, left, rcond=None)[1].sum())

    tried = _frequencies(q, left, low, high / max(step, 1e-12))
    near = np.linspace(-1.0, 1.0, STEPS) * np.pi / max(np.ptp(q), 1e-12)
    refined = [max(one + near, key=explained) for one in tried]
    if not refined:
        return None
    f = float(max(refined, key=explained))
    full = np.column_stack([columns, waves(f)])
    (errors, fits), (less, _) = predicted(full, torque), predicted(columns, torque)
    share, clear = gain(errors, less)
    if share < least or max(clear, steady_gain(errors, less)) < CLEAR:
        return None
    amplitudes = -fits[:, -2:]  # the motor's torque balances that of the magnets
    a, b = amplitudes.mean(axis=0)
    cell = np.pi / max(float(np.ptp(q)), 1e-12) / STEPS
    spread = deviations(amplitudes).tolist()
    return Spent("cogging", (f, float(a), float(b)), (cell, *spread), share)


@dataclass(frozen=True, eq=False)
class _Part:
    """A record where its joint moves.

    Attributes:
        angle: Angle of all rows [rad], shape (N,).
        count: Samples over which it is smoothed.
        use: The rows with motion, shape (N,).
        q: Angle in them [rad], shape (M,).
        columns: Regressors of the torque there, shape (M, 6).
        torque: Torque there [N m], shape (M,).
        moved: Change of the angle per sample there [rad], shape (M,).
    """

    JOINED: ClassVar = ("q", "columns", "torque")

    angle: Floats
    count: int
    use: NDArray[np.bool_]
    q: Floats
    columns: Floats
    torque: Floats
    moved: Floats

    def waves(self, f: float) -> Floats:
        """Return cosine and sine of a frequency where the joint moves, shape (M, 2)."""
        both = np.stack([np.cos(f * self.angle), np.sin(f * self.angle)], axis=1)
        return np.asarray(savgol_filter(both, self.count, 2, axis=0)[self.use])


def _moving(joint: Joint, log: Log, time: float) -> _Part:
    """Return a record where its joint moves, smoothed over a time [s]."""
    count = min(max(LEAST_SMOOTH, round(time / log.dt)) | 1, (len(log) - 1) | 1)
    angle = log.measured["q_m"]
    q, v, a = (savgol_filter(angle, count, 2, deriv=k, delta=log.dt) for k in range(3))
    use = log.inside & (np.abs(v) > STUCK * float(np.sqrt(np.mean(v[log.inside] ** 2))))
    columns = np.stack([a, v, np.sign(v), np.ones_like(v), np.cos(q), np.sin(q)], axis=1)
    torque = joint.parameters.k_t * joint.parameters.n * log.command + log.load
    smooth = savgol_filter(torque, count, 2)
    moved = np.abs(v[use]) * log.dt
    return _Part(angle, count, use, q[use], columns[use], smooth[use], moved)


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
