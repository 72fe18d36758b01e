"""Figures of merit of torque tracking, from the traces of a batch of episodes."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import Complex, Floats
from cjt_gym.training.evaluation.rollout import Traces

SETTLING_BAND = 0.1
"""Of a step within which it has settled: wide enough for what friction may leave."""
SMALLEST_STEP = 0.5
"""Of the largest level; smaller steps drown in friction and tell nothing of settling."""
BAND = 1.0 / 12.0
"""Octaves over which a response is averaged."""
REST = 0.2
"""At the beginning of an episode, which does not count for noise [s]."""
RESAMPLES = 2000
"""Of a bootstrap: enough for 95 % intervals to two digits."""


def squared_errors(traces: Traces) -> Floats:
    """Return the mean squared error of each episode [N^2 m^2], shape (episodes,)."""
    return np.asarray(np.mean(traces.error**2, axis=1))


def rms(values: Floats) -> float:
    """Return the root mean square of all values [their unit]."""
    return float(np.sqrt(np.mean(np.square(values))))


def rmse(traces: Traces) -> float:
    """Return the root mean square error over all episodes [N m]."""
    return rms(traces.error)


def nrmse(traces: Traces) -> float:
    """Return the error over the root mean square of the reference [-]; NaN without reference."""
    scale = rms(traces.reference)
    return rmse(traces) / scale if scale > 0.0 else float("nan")


def effort_rms(traces: Traces) -> float:
    """Return the root mean square of the commanded motor torque [N m]."""
    return rms(traces.command)


def command_change(traces: Traces) -> float:
    """Return the root mean square of the command's change between control steps [N m]."""
    return rms(np.diff(traces.command, axis=1))


def command_above(traces: Traces, frequency: float) -> float:
    """Return the root mean square of what the command holds above a frequency [Hz], in N m."""
    steps = traces.command.shape[1]
    spectrum = np.fft.rfft(traces.command, axis=1)
    spectrum[:, np.fft.rfftfreq(steps, traces.dt) < frequency] = 0.0
    return rms(np.fft.irfft(spectrum, steps, axis=1))


def bootstrap_rmse(traces: Traces) -> tuple[float, float]:
    """Return the 95 % interval of `rmse`, by drawing episodes with replacement [N m]."""
    return bootstrap_rms(squared_errors(traces))


def bootstrap_rms(squares: Floats) -> tuple[float, float]:
    """Return the 95 % interval of the root of the mean of squares, shape (episodes,)."""
    means = squares[_resampled(len(squares))].mean(axis=1)
    low, high = np.sqrt(np.quantile(means, (0.025, 0.975)))
    return float(low), float(high)


def bootstrap_ratio(one: Traces, other: Traces) -> tuple[float, float, float]:
    """Return the ratio of two agents' rmse over the same episodes and its 95 % interval.

    Episodes are drawn in pairs, so that what they have in common cancels.
    """
    a, b = squared_errors(one), squared_errors(other)
    rows = _resampled(len(a))
    ratios = np.sqrt(a[rows].mean(axis=1) / b[rows].mean(axis=1))
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(np.sqrt(a.mean() / b.mean())), float(low), float(high)


def _resampled(count: int) -> NDArray[np.int64]:
    return np.random.default_rng(0).integers(count, size=(RESAMPLES, count))


def steps_of(traces: Traces) -> list[tuple[Floats, float, float]]:
    """Cut episodes of held levels at every jump of the reference.

    Returns:
        For each jump of at least half the largest level: the torque until the next one, shape
        (samples,), the level before and the level after [N m].
    """
    smallest = SMALLEST_STEP * float(np.max(np.abs(traces.reference), initial=0.0))
    found = []
    for reference, tau in zip(traces.reference, traces.tau, strict=True):
        jumps = np.flatnonzero(np.diff(reference, prepend=0.0))
        ends = np.append(jumps, len(reference))[1:]
        levels = np.concatenate([[0.0], reference[jumps]])
        for start, end, old, new in zip(jumps, ends, levels[:-1], levels[1:], strict=True):
            if abs(new - old) >= smallest > 0.0:
                found.append((tau[start:end], float(old), float(new)))
    return found


def overshoot(traces: Traces) -> float:
    """Return how far steps overshoot, over their height, in the mean [-]; NaN without steps."""
    values = [
        max(0.0, float(np.max((tau - new) * np.sign(new - old)))) / abs(new - old)
        for tau, old, new in steps_of(traces)
    ]
    return float(np.mean(values)) if values else float("nan")


def settling_time(traces: Traces) -> float:
    """Return the median time until a step stays within 10 % of its height [s].

    A step that does not settle before the next one counts as infinitely long; infinity is
    returned where that is more than every second.
    """
    times = []
    for tau, old, new in steps_of(traces):
        outside = np.flatnonzero(np.abs(tau - new) > SETTLING_BAND * abs(new - old))
        last = int(outside[-1]) + 1 if len(outside) else 0
        times.append(last * traces.dt if last < len(tau) else float("inf"))
    return sorted(times)[len(times) // 2] if times else float("nan")


def frequency_response(traces: Traces, low: float, high: float) -> tuple[Floats, Complex]:
    """Return frequencies [Hz] and responses from reference to torque there, shape (bands,).

    They are averaged over bands of a twelfth octave, from `low` to `high` [Hz].

    In each band it is the sum over episodes and bins of conj(R) T over that of |R|^2 (the H1
    estimate), with R and T the discrete Fourier transforms of reference and torque.
    """
    f = np.fft.rfftfreq(traces.tau.shape[1], traces.dt)
    wanted, got = np.fft.rfft(traces.reference), np.fft.rfft(traces.tau)
    cross, power = (np.conj(wanted) * got).sum(axis=0), (np.abs(wanted) ** 2).sum(axis=0)
    edges = low * 2.0 ** np.arange(0.0, np.log2(high / low) + BAND, BAND)
    bands = [np.flatnonzero((f >= a) & (f < b)) for a, b in itertools.pairwise(edges)]
    bands = [band for band in bands if len(band) > 0 and power[band].sum() > 0.0]
    centres = np.array([np.exp(np.mean(np.log(f[band]))) for band in bands])
    response = np.array([cross[band].sum() / power[band].sum() for band in bands])
    return centres, response


def bandwidth(traces: Traces, low: float, high: float) -> float:
    """Return where the response first falls 3 dB below what it is in the lowest octave [Hz].

    Where the torque follows up to `high` [Hz], that is returned.
    """
    f, response = frequency_response(traces, low, high)
    gain = np.abs(response)
    gain = gain / np.mean(gain[f <= 2.0 * low])
    below = np.flatnonzero((gain < np.sqrt(0.5)) & (f > 2.0 * low))
    if len(below) == 0:
        return high
    k = int(below[0])
    share = (gain[k - 1] - np.sqrt(0.5)) / (gain[k - 1] - gain[k])
    return float(f[k - 1] * (f[k] / f[k - 1]) ** np.clip(share, 0.0, 1.0))


def noise_amplification(traces: Traces) -> float:
    """Return the noise of the command relative to that of the torque sensor [-].

    It is the standard deviation of the command over that of the measured torque minus the true
    one, both after 0.2 s under zero reference; NaN where the sensor has no noise.
    """
    skip = int(REST / traces.dt)
    noise = float(np.std((traces.tau_measured - traces.tau)[:, skip:]))
    if noise == 0.0:
        return float("nan")
    commands = traces.command[:, skip:]
    return float(np.sqrt(np.mean(np.var(commands, axis=1)))) / noise
