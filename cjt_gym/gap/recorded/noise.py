"""Normal scatter of each channel.

There are three sources for the standard deviation of a sample: the joint file's specification, the
channel's resolution (a uniform error of one step has step / sqrt(12)), and the data at frequencies
that no joint reaches (differences of high order). The specification counts unless the data show
clearly less white noise; without a specification the larger of the others counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb

from cjt_gym.gap.recorded.series import Series
from cjt_gym.joint import JointFile
from cjt_gym.joint.kernel.arrays import Floats

ORDER, OTHER_ORDER = 8, 5
SAME = 0.06
"""Relative difference up to which two estimates of the noise agree."""
OVERSTATED = 1.3
"""Ratio of specified to observed white noise above which the data are believed."""
MOST_JITTER = 0.15
"""Sampling jitter that a channel may show whatever is stated, in samples."""
WINDOW = 50
QUIET = 0.25
"""Share of quietest windows from which a channel's noise is estimated."""


FINEST, SEEN = 1e-4, 1e-6
"""Smallest deviation of an unspecified channel as a share of its spread, as of a 13 bit converter,
and where its samples show white noise. Otherwise rounding errors would decide in a simulated record
without noise."""


@dataclass(frozen=True)
class ChannelNoise:
    """Scatter of one channel."""

    specified: float  # deviation that the joint file allows, with its resolution; 0 if unknown
    stated: bool  # whether the joint file states a noise besides the resolution
    observed: float  # deviation that the data show at high frequency
    white: bool  # whether differences of another order agree
    lattice: float  # step of the values found in the data; 0 if they lie on no lattice
    resolution: float  # step that the joint file states; 0 if unknown
    std: float  # deviation that counts
    jitter: float  # deviation of the sampling times that this channel shows [s]


def channel_noise(
    series: Series, joint: JointFile, name: str, slope: float, logged: Floats | None = None
) -> ChannelNoise:
    """Return the scatter of a channel.

    Args:
        series: The record.
        joint: The joint, for its specification.
        name: The channel.
        slope: Jitter of the sampling times [s], whose share is not the channel's own noise.
        logged: Its values as they were logged, NaN where one is missing; on an even grid they may
            lie on no lattice any more. By default those of the series.
    """
    known = joint.sensors.get(name, {})
    resolution = known["resolution"].number if "resolution" in known else 0.0
    noise = known["noise"].number if "noise" in known else 0.0
    specified = float(np.hypot(noise, resolution / np.sqrt(12.0)))
    x = series[name]
    lattice = lattice_step(x[series.valid[name]] if logged is None else logged[np.isfinite(logged)])
    shaken = slope * np.abs(series.speed(name))
    observed = high_frequency_std(x, series.valid[name], shaken)
    other = high_frequency_std(x, series.valid[name], shaken, OTHER_ORDER)
    white = abs(observed - other) <= SAME * observed
    floor = lattice / np.sqrt(12.0)
    std = max(specified, floor)
    if noise == 0.0:
        std = max(std, observed)
    elif white and 0.0 < OVERSTATED * observed < specified:
        std = max(observed, floor)
    if specified == 0.0:
        std = max(std, (SEEN if white and observed > 0.0 else FINEST) * float(np.std(x)))
    most = max(2.0 * slope, MOST_JITTER * series.dt)
    shown = observed_jitter(x, series.valid[name], series.speed(name), most)
    if shown > slope:  # what the clock scatters is no noise of the channel
        shaken = shown * np.abs(series.speed(name))
        observed = min(observed, high_frequency_std(x, series.valid[name], shaken))
    std, stated = max(std, 1e-12), noise > 0.0
    return ChannelNoise(specified, stated, observed, white, lattice, resolution, std, shown)


def observed_jitter(x: Floats, valid: NDArray[np.bool_], speed: Floats, limit: float) -> float:
    """Return the deviation of the sampling times [s], up to a limit.

    With jitter the scatter grows with the slope of the signal: the fastest tenth of the samples is
    compared with the slower half.
    """
    if limit <= 0.0 or len(x) < 4 * WINDOW:
        return 0.0
    d = np.diff(x, ORDER) / np.sqrt(float(comb(2 * ORDER, ORDER)))
    half = ORDER // 2
    v, good = np.abs(speed[half:-half]), valid[half:-half]
    fast, slow = good & (v >= np.quantile(v, 0.9)), good & (v <= np.quantile(v, 0.5))
    if not fast.any() or not slow.any() or np.median(v[fast]) == 0.0:
        return 0.0
    excess = np.median(d[fast] ** 2) / 0.455 - np.median(d[slow] ** 2) / 0.455
    return float(min(np.sqrt(max(excess, 0.0) / np.median(v[fast] ** 2)), limit))


def high_frequency_std(
    x: Floats, valid: NDArray[np.bool_], jitter: Floats, order: int = ORDER
) -> float:
    """Return the deviation of white noise under a smooth signal.

    The eighth difference passes white noise with a known gain and rejects slow signals. Windows are
    ranked by the slope of the signal, as steep ones carry the jitter, whose share is subtracted;
    the median of the flattest quarter counts.

    Args:
        x: Samples, shape (N,).
        valid: Whether they were measured, shape (N,).
        jitter: Deviation that the jitter of the sampling times causes, shape (N,).
        order: Order of the difference.
    """
    if len(x) < 4 * WINDOW:
        return 0.0
    gain = np.sqrt(float(comb(2 * order, order)))
    d = np.diff(x, order) / gain
    good = np.convolve(~valid, np.ones(order + 1), "valid") == 0
    count = len(d) // WINDOW
    d = np.where(good, d, np.nan)[: count * WINDOW].reshape(count, WINDOW)
    shaken = jitter[: count * WINDOW].reshape(count, WINDOW)
    steep = shaken.max(axis=1)
    known = np.isfinite(d)
    power = np.where(known, d * d, 0.0).sum(axis=1) / np.where(known.any(1), known.sum(1), np.nan)
    flattest = np.argsort(steep)[: max(int(QUIET * count), 4)]
    chosen = np.maximum(power - np.mean(shaken**2, axis=1), 0.0)[flattest]
    chosen = chosen[np.isfinite(chosen)]
    return float(np.sqrt(np.median(chosen))) if chosen.size else 0.0


ONCE = 0.9
"""Share above which values are called unique, or distances multiples of a step."""
SMALLEST = (0.05, 0.01)
"""Quantiles of the distances that may be one step; fast motion leaves few of that size."""
FAR = 10.0
"""Steps up to which a distance tells whether it is a multiple."""


def lattice_step(x: Floats) -> float:
    """Return the step of the lattice on which all values lie, 0 if there is none.

    The step is the smallest distance between two different values, if nearly all distances are
    whole multiples of it. A channel that moves at constant speed, so that hardly any value repeats,
    has equal distances without a lattice.
    """
    distinct = np.unique(x)
    if distinct.size < 4:
        return 0.0
    gaps = np.diff(distinct)
    scale = max(float(np.abs(distinct).max()), 1e-300)
    gaps = gaps[gaps > 1e-9 * scale]
    if gaps.size < 3:
        return 0.0
    for share in SMALLEST:
        step = float(np.quantile(gaps, share))
        step = float(np.median(gaps[gaps < 1.5 * step]))
        ratio = gaps / step
        if distinct.size > ONCE * x.size and float(np.mean(np.round(ratio) == 1.0)) > ONCE:
            return 0.0
        near = ratio[ratio < FAR]  # of long distances most are nearly whole multiples anyway
        if float(np.mean(np.abs(near - np.round(near)) < 0.02 * np.maximum(near, 1.0))) > ONCE:
            return step
    return 0.0
