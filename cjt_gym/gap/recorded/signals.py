"""Torque and current between the samples, as the bodies feel them."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.series import Series
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import compiled

LEAST_TORQUE = 0.2
"""Share of the torque per ampere that hot windings keep at least."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)
INSTANTS = tuple(float(at) for at in 0.5 * (1.0 + _POINTS))
MEAN: Floats = 0.5 * _WEIGHTS
"""Weights of the mean over an interval, shape (5,)."""


def ahead(x: Floats) -> Floats:
    """Return the next sample of each, the last one repeated; shape (N,)."""
    return np.concatenate([x[1:], x[-1:]])


def interval_mean(x: Floats, weight: float) -> Floats:
    """Return the mean over the interval that begins at each sample.

    Args:
        x: Samples, shape (N,).
        weight: Share of the newer sample: 0.5 for a straight line, 1 for a step that follows the
            older sample at once.
    """
    return np.asarray((1.0 - weight) * x + weight * ahead(x))


def smooth_mean(x: Floats) -> Floats:
    """Return the mean over the interval after each sample of a smooth signal, by a cubic."""
    before, after = np.concatenate([x[:1], x[:-1]]), ahead(x)
    return np.asarray((13.0 * (x + after) - before - ahead(after)) / 24.0)


def shifted(x: Floats, samples: float) -> Floats:
    """Return the signal shifted earlier (samples > 0), interpolated by a cubic; shape (N,).

    Value k of the result is the signal at k + samples.
    """
    if samples == 0.0:
        return x
    whole = int(np.floor(samples))
    at = np.arange(len(x)) + whole
    near = (x[np.clip(at + j, 0, len(x) - 1)] for j in (-1, 0, 1, 2))
    return np.asarray(sum(w * y for w, y in zip(_cubic(samples - whole), near, strict=True)))


def shift_noise(samples: float) -> float:
    """Return the factor by which `shifted` changes the deviation of white noise."""
    return float(np.linalg.norm(_cubic(samples - np.floor(samples))))


def _cubic(f: float) -> tuple[float, float, float, float]:
    return (
        -f * (1 - f) * (2 - f) / 6.0,
        (1 + f) * (1 - f) * (2 - f) / 2.0,
        (1 + f) * f * (2 - f) / 2.0,
        -(1 + f) * f * (1 - f) / 6.0,
    )


def motor_current(fields: Fields, series: Series) -> Floats:
    """Return the current over each interval [A], measured or else from the command; shape (N,)."""
    if "i" in series and series.slow:  # a log that is slower than the drive holds nothing
        i, weight = series["i"], fields["w_i"]
        return np.asarray(smooth_mean(i) + (weight - 0.5) * (ahead(i) - i) - fields["i_0"])
    if "i" in series:
        return interval_mean(series["i"], fields["w_i"]) - fields["i_0"]
    weight = _newer_share(fields["lag"] / series.dt)
    return interval_mean(commanded_current(fields, series), weight) - fields["i_0"]


def commanded_current(fields: Fields, series: Series) -> Floats:
    """Return the current with which the drive answers its command, at the samples [A]; shape (N,).

    The command is held over a sample, delayed, rounded, limited, and passes a first-order lag. A
    delay of minus a sample is that of a log which is slower than the drive: the current is already
    that of the command beside it.
    """
    c = series["i_cmd"]
    if fields["step"] > 0.0:
        c = np.round(c / fields["step"]) * fields["step"]
    if np.isfinite(fields["i_max"]):
        c = np.clip(c, -fields["i_max"], fields["i_max"])
    if fields["dead"] > 0.0:
        c = np.where(np.abs(c) < fields["dead"], 0.0, c - fields["less"] * np.sign(c))
    if np.isfinite(fields["slew"]):
        c = followed(c, fields["slew"] * series.dt)
    older, newer, a, reach = taken_over(fields, c, series.dt)
    drive = (reach - a) * older + (1.0 - reach) * newer
    start = newer[0]
    y, _ = lfilter([1.0], [1.0, -a], drive[:-1], zi=[a * start])
    return np.concatenate([[start], y])


def taken_over(fields: Fields, c: Floats, dt: float) -> tuple[Floats, Floats, float, float]:
    """Return a drive's response to its command: y[k+1] = a y + (b - a) older + (1 - b) newer.

    Without a lag y[k+1] is the mean over the sample, so that the current changes with the delay
    gradually, not at whole samples alone, where no fit could find its way.

    Args:
        fields: The model.
        c: Command, shape (N,).
        dt: Sample time [s].

    Returns:
        The older and the newer command that act within each sample, shape (N,); a; b.
    """
    lag, total = fields["lag"], max(fields["delay"] / dt, -1.0)
    whole = int(np.floor(total))
    late = (total - whole) * dt
    a = float(np.exp(-dt / lag)) if lag > 0.0 else 0.0
    reach = float(np.exp(-(dt - late) / lag)) if lag > 0.0 else late / dt
    return _held(c, whole + 1), _held(c, whole), a, reach


@compiled
def followed(x: Floats, most: float) -> Floats:
    """Return a signal limited to a largest change per sample, shape (N,)."""
    y = np.empty(x.size)
    last = x[0]
    for k in range(x.size):
        last += min(max(x[k] - last, -most), most)
        y[k] = last
    return y


def _held(c: Floats, samples: int) -> Floats:
    if samples < 0:
        return ahead(c)
    if samples == 0:
        return c
    samples = min(samples, len(c) - 1)
    return np.concatenate([np.full(samples, c[0]), c[: len(c) - samples]])


def joint_torque(fields: Fields, series: Series) -> Floats:
    """Return the true joint torque at the samples, from the measured one [N m]; shape (N,)."""
    tau = shifted(series["tau"], fields["late"] / series.dt)
    return (tau - fields["tau_0"]) / fields["gain"]


def motor_torque(fields: Fields, series: Series) -> Floats:
    """Return the torque on the motor over each interval [N m], shape (N,)."""
    i = motor_current(fields, series)
    torque = fields["n"] * fields["k_t"] * i
    if fields["derate"] != 0.0:
        a = np.exp(-series.dt / fields["heat"])
        heat = np.concatenate([series.past, i]) ** 2
        warm = lfilter([0.0, 1.0 - a], [1.0, -a], heat)[len(series.past) :]
        torque = torque * np.maximum(1.0 - fields["derate"] * warm, LEAST_TORQUE)
    return np.asarray(torque + fields["offset"])


def torque_rise(fields: Fields, series: Series) -> Floats:
    """Return how much the torque of the current rises over each interval [N m], shape (N,).

    A current that follows its command at once does not rise within an interval; one with a lag
    does, in the first moment about the middle, as a straight line of a share of its change does.
    """
    if "i" not in series and fields["lag"] <= 0.0:
        return np.zeros(len(series))
    i = series["i"] if "i" in series else commanded_current(fields, series)
    change = ahead(i) - i
    share = 1.0 if series.slow else _rising(fields["lag"] / series.dt)
    return np.asarray(fields["n"] * fields["k_t"] * share * change)


def _newer_share(lag: float) -> float:
    """Return the share of the newer sample in the mean of a current behind a lag in samples.

    Over an interval the current approaches a constant; without a lag it is there at once.
    """
    if lag <= 0.0:
        return 1.0
    done = -np.expm1(-1.0 / lag)
    return float((1.0 - lag * done) / done)


def _rising(lag: float) -> float:
    """Return that share for a lag in samples: 1 for a long one, 0 for none."""
    if lag > 20.0 or lag <= 0.0:
        return float(lag > 0.0)
    rest = float(np.exp(-1.0 / lag))
    moment = 0.5 * lag * (1.0 - rest) - lag * lag + rest * (lag * lag + lag)
    return 12.0 * moment / (1.0 - rest)


def periodic_torque(fields: Fields, q: Floats, transmitted: Floats) -> Floats:
    """Return cogging and gear ripple at motor angles [N m], of the shape of q and transmitted."""
    torque = np.zeros(np.shape(q))
    if fields["cog_f"] != 0.0:
        x = fields["cog_f"] * q
        torque += fields["cog_a"] * np.cos(x) + fields["cog_b"] * np.sin(x)
    if fields["rip_f"] != 0.0:
        x = fields["rip_f"] * q
        torque += (fields["rip_a"] * np.cos(x) + fields["rip_b"] * np.sin(x)) * transmitted
    return torque


def within(x: Floats) -> Floats:
    """Return a smooth signal at Gauss's points of the interval after each sample, shape (5, N).

    `MEAN @` what is computed there is its mean over the interval: also of a ripple that the joint
    passes within few samples.
    """
    return np.stack([shifted(x, at) for at in INSTANTS])


def weight(fields: Fields, q: Floats) -> Floats:
    """Return the torque that gravity needs at each angle of the load [N m], shape (N,)."""
    return np.asarray(fields["grav_a"] * np.cos(q) + fields["grav_b"] * np.sin(q))
