"""Drive response where both command and current were measured: delay, lag and gain.

The measured current is compared, sample by sample, with the command after a dead time and a
first-order lag; gain and offset are free. Dead times below `LEAST` samples cannot be distinguished
from the instant within a sample at which a log writes its rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.horizons.prediction.pieces import Piece
from cjt_gym.gap.recorded.series import SLOW
from cjt_gym.joint.kernel.arrays import Floats

DELAYS = np.arange(0.0, 8.01, 0.25)
LAGS = (0.0, 0.3, 0.6, 1.0, 1.5, 2.5, 4.0, 7.0, 12.0)
"""Candidate dead times and time constants, in samples."""
LEAST = 0.6
"""Shortest reported dead time, in samples."""
USUAL = 1.5
"""Longest dead time that a log slower than the drive may owe to its rows, in samples."""
BETTER = 0.8
"""Largest remaining mean square, as a share of that without dead time or lag."""
LAGS_BY = 0.8
"""Largest mean square with a lag, as a share of that with a dead time alone: less than that is what
uneven sampling makes of a dead time of one row."""
FOLLOWS = 0.5
"""Least share of the current's variance that its command must explain."""
MOSTLY = 0.75
"""Least share of the pieces in which dead time and lag must help."""


@dataclass(frozen=True)
class DriveFit:
    """How the current follows its command.

    Attributes:
        delay: Dead time [s].
        lag: Time constant [s].
        before: rms residual of the current with the command alone [A].
        after: rms residual with dead time and lag [A].
        step: Accuracy of the dead time [s].
        pieces: Share of the pieces of the record in which dead time and lag help.
    """

    delay: float
    lag: float
    before: float
    after: float
    step: float
    pieces: float

    @property
    def late(self) -> bool:
        """Whether the delay of the current exceeds the timing uncertainty of a log."""
        return self._helps and self.delay > LEAST * self.row

    @property
    def beyond_a_row(self) -> bool:
        """Whether a log slower than the drive cannot have made all of the delay.

        The instants of its rows leave up to one sample open. A lag of less than a sample is part of
        the delay.
        """
        brief = self.lag < self.row
        return self._helps and self.row > SLOW and brief and self.lateness > USUAL * self.row

    @property
    def lateness(self) -> float:
        """Mean time by which the current is late [s]."""
        if self.lag == 0.0:
            return self.delay
        return self.delay + self.row / (1.0 - float(np.exp(-self.row / self.lag)))

    @property
    def row(self) -> float:
        """Sample time of the log [s]."""
        return 4.0 * self.step

    @property
    def lagging(self) -> bool:
        """Whether the current follows with a lag."""
        return self._helps and self.lag > self.step and not self.beyond_a_row

    @property
    def _helps(self) -> bool:
        return self.after**2 < BETTER * self.before**2 and self.pieces >= MOSTLY


def fit_drive(log: Log, pieces: list[Piece]) -> DriveFit | None:
    """Return how the current follows its command; None if it does not or nothing was measured."""
    if log.wanted is None or not np.any(np.diff(log.wanted)):
        return None
    i, c, use = log.command, log.wanted, log.whole.copy()
    use[: int(DELAYS[-1]) + 2] = False
    if np.var(i[use]) == 0.0:
        return None
    plain, tried = _left(i, c, use), []
    for lag in LAGS:
        slow = _lagged(c, lag)
        trials = [(_left(i, _late(slow, delay), use), delay, lag) for delay in DELAYS]
        tried.append(min(trials, key=lambda trial: float(np.sum(trial[0] ** 2))))
    best = min(tried, key=lambda trial: float(np.sum(trial[0] ** 2)))
    if np.sum(best[0] ** 2) > LAGS_BY * np.sum(tried[0][0] ** 2):
        best = tried[0]
    left, delay, lag = best
    if np.sum(left**2) > (1.0 - FOLLOWS) * np.sum((i[use] - np.mean(i[use])) ** 2):
        return None
    index = np.flatnonzero(use)
    better = [
        np.sum(left[a:b] ** 2) < np.sum(plain[a:b] ** 2)
        for p in pieces
        if (a := np.searchsorted(index, p.start)) < (b := np.searchsorted(index, p.stop))
        and np.ptp(c[p.start : p.stop]) > 0.0
    ]
    return DriveFit(
        float(delay * log.dt), float(lag * log.dt),
        float(np.sqrt(np.mean(plain**2))), float(np.sqrt(np.mean(left**2))),
        0.25 * log.dt, float(np.mean(better)) if better else 0.0,
    )  # fmt: skip


def _lagged(c: Floats, lag: float) -> Floats:
    if lag == 0.0:
        return c
    a = float(np.exp(-1.0 / lag))
    return np.asarray(lfilter([0.0, 1.0 - a], [1.0, -a], c - c[0]) + c[0])


def _late(c: Floats, delay: float) -> Floats:
    at = np.arange(len(c)) - delay
    return np.asarray(np.interp(at, np.arange(len(c)), c))


def _left(i: Floats, model: Floats, use: NDArray[np.bool_]) -> Floats:
    """Return the residual of a regression of the current on a model."""
    x = np.stack([model[use], np.ones(int(use.sum()))], axis=1)
    return np.asarray(i[use] - x @ np.linalg.lstsq(x, i[use], rcond=None)[0])
