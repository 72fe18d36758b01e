"""Where the residual of the motor repeats with the angle, and where the command moves in steps.

A torque that is periodic in the angle is found without fitting: the gradient of the squared
innovations with respect to the torque at every sample is one filtered signal, and its transform
over the angle shows the spatial frequencies at once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve, find_peaks

from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.signals import MEAN, commanded_current, taken_over, within
from cjt_gym.gap.stages.chain import MOTOR
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.predictor import torque_response
from cjt_gym.joint.kernel.arrays import Floats

HIGHEST = 20_000.0
FEWEST = 2.0
"""Highest spatial frequency sought [rad/rad], and fewest periods of a wave within the travel: a
slower one looks like a spring."""
CELLS = 1 << 20
TRIED, PEAKS = 12, 3
"""Number of peaks of the spectrum that are fitted, and of those that are returned."""
SOME = 1500
"""Samples over which the power of a wave is averaged."""
COARSE, FINE = 40.0, 41
"""Steps within the range of a command up to which they count as coarse; rates tried in a cell."""
LINE_PERIODS = 8
"""Minimum number of periods of a wave in time within a record."""


def filtered(response: Floats, torque: Floats) -> Floats:
    """Return the normalised innovations that a torque causes, shape (N,) or (N, columns)."""
    if torque.ndim == 1:
        return np.asarray(fftconvolve(torque, response)[: len(torque)])
    return np.asarray(fftconvolve(torque, response[:, None], axes=0)[: len(torque)])


def periodic_starts(
    stages: Stages, fields: Fields, residual: Floats, kind: str
) -> tuple[tuple[float, float, float], ...]:
    """Return starting values (f, a, b) of cogging (kind "cog") or gear ripple ("rip").

    Args:
        stages: The record.
        fields: The model that left the residual.
        residual: Normalised innovations of the motor, shape (N,).
        kind: "cog" or "rip".
    """
    s = stages.setting
    q, v = s.series["q_m"], s.series.speed("q_m")
    tau = stages.transmitted(fields, s.series)
    if kind == "rip" and not tau.any():
        return ()
    weight = tau if kind == "rip" else np.ones(len(q))
    gain = stages.gains["motor"]
    response = torque_response(stages.chain("motor", fields), gain.k, MOTOR) / gain.std
    left = _without_trends(residual, response, v, tau)
    frequencies, power = _spectrum(left, response, q, v * s.series.dt, weight)
    step = s.noise["q_m"].lattice if "q_m" in s.noise else 0.0
    if step > 0.0:  # a wave shorter than two steps is an echo of the encoder's own lattice
        power = power[frequencies < np.pi / step]
        frequencies = frequencies[frequencies < np.pi / step]
    if frequencies.size == 0:
        return ()
    peaks, _ = find_peaks(power)
    peaks = peaks[np.argsort(power[peaks])[::-1][:TRIED]]
    found = []
    angles, loads = within(q), within(weight)
    for f in frequencies[peaks]:
        waves = [MEAN @ (wave(f * angles) * loads) for wave in (np.cos, np.sin)]
        fine = filtered(response, np.column_stack(waves))
        (a, b), rest = np.linalg.lstsq(fine, left, rcond=None)[:2]
        found.append((float(rest.sum()), (float(f), float(a), float(b))))
    return tuple(start for _, start in sorted(found)[:PEAKS])


def ripple_amplitudes(stages: Stages, fields: Fields, residual: Floats) -> tuple[Floats, Floats]:
    """Return cycles per revolution and the amplitude of torque that repeats with them [N m].

    The residual holds the normalised innovations of the motor that the model left, shape (N,).
    """
    s = stages.setting
    q, v = s.series["q_m"], s.series.speed("q_m")
    tau = stages.transmitted(fields, s.series)
    gain = stages.gains["motor"]
    response = torque_response(stages.chain("motor", fields), gain.k, MOTOR) / gain.std
    left = _without_trends(residual, response, v, tau)
    f, power = _spectrum(left, response, q, v * s.series.dt, np.ones(len(q)))
    if f.size == 0:
        return f, power
    moved = np.abs(v * s.series.dt)
    usual = float(np.median(moved[moved > 0.1 * moved.mean()]))
    f, power = f[f < 0.5 * np.pi / usual], power[f < 0.5 * np.pi / usual]
    if f.size == 0:
        return f, power
    part = _wave_power(f, response, v * s.series.dt, np.ones(len(q)))
    squares = 0.5 * max(len(v) // SOME, 1) * part  # of a cosine, over all samples
    return f, np.asarray(np.sqrt(power * part) / squares)


def _without_trends(residual: Floats, response: Floats, v: Floats, tau: Floats) -> Floats:
    """Return the residual without what friction, damping, stiffness and gain would explain."""
    rough = np.tanh(v / max(0.02 * float(np.std(v)), 1e-12))
    features = np.column_stack([np.ones(len(v)), rough, v, tau, tau * rough, np.gradient(v)])
    features /= np.maximum(np.abs(features).max(axis=0), 1e-12)
    x = filtered(response, features)
    good = residual != 0.0
    x[~good] = 0.0
    return np.asarray(residual - x @ np.linalg.lstsq(x, residual, rcond=None)[0])


def _spectrum(
    residual: Floats, response: Floats, q: Floats, v: Floats, weight: Floats
) -> tuple[Floats, Floats]:
    """Return spatial frequencies [rad/rad] and the share of squares that a wave explains."""
    travel = float(np.ptp(q))
    fast = float(np.quantile(np.abs(v), 0.9))
    if travel <= 0.0 or fast <= 0.0:
        return np.zeros(0), np.zeros(0)
    gradient = fftconvolve(residual, response[::-1])[len(response) - 1 :][: len(q)] * weight
    low, high = 2.0 * np.pi * FEWEST / travel, HIGHEST
    cell = max(2.0 * np.pi / high / 6.0, travel / CELLS * 4.0)
    index = np.minimum(((q - q.min()) / cell).astype(np.int64), CELLS - 1)
    size = int(2 ** np.ceil(np.log2(index.max() + 1))) * 4
    binned = np.bincount(index, weights=gradient, minlength=size)
    transform = np.asarray(np.abs(np.fft.rfft(binned)) ** 2, dtype=np.float64)
    f = np.asarray(2.0 * np.pi * np.arange(transform.size) / (size * cell), dtype=np.float64)
    good = (f >= low) & (f <= min(high, np.pi / cell / 2.0))
    f, transform = f[good], transform[good]
    if f.size == 0:
        return f, transform
    return f, np.asarray(transform / _wave_power(f, response, v, weight))


def _wave_power(f: Floats, response: Floats, v: Floats, weight: Floats) -> Floats:
    """Return the sum of squares of the innovations that a unit wave of each frequency causes.

    A wave that the joint passes in less than two samples appears aliased.
    """
    gain = np.abs(np.fft.rfft(response, 4096)) ** 2
    cycles = np.linspace(0.0, 0.5, gain.size)
    some = slice(None, None, max(len(v) // SOME, 1))
    # A sample moves the angle by v dt; `v` comes in rad per sample here.
    coarse = np.geomspace(f[0], f[-1] * (1 + 1e-9), 150)
    step = np.abs(v[some])
    share = np.square(weight[some])
    table = np.array(
        [np.sum(share * np.interp(_folded(x * step / (2.0 * np.pi)), cycles, gain)) for x in coarse]
    )
    table = np.maximum(table, 1e-3 * table.max())
    return np.asarray(np.exp(np.interp(np.log(f), np.log(coarse), np.log(table))))


def _folded(cycles: Floats) -> Floats:
    """Return the aliases of frequencies in cycles per sample, within 0 .. 0.5."""
    return np.asarray(np.abs(cycles - np.round(cycles)))


def command_steps(stages: Stages, fields: Fields) -> tuple[tuple[float], ...]:
    """Return candidates for the resolution [A] to which the drive rounds its command.

    The error of rounding repeats with the command: a transform over the command shows its period.
    """
    s = stages.setting
    if "drive" not in stages.names:
        return ()
    c = s.series["i_cmd"]
    error = s.series["i"] - commanded_current(fields, s.series) - fields["i_0"]
    older, newer, a, b = taken_over(fields, c, s.series.dt)
    fresh = error[1:] - a * error[:-1]  # what this sample's command has added
    parts = [(b - a, older[:-1]), (1.0 - b, newer[:-1])]
    noise = s.std("i")
    span = float(np.ptp(c))
    if noise <= 0.0 or span <= 0.0:
        return ()
    cell = max(noise / 16.0, span / CELLS * 4.0)
    size = int(2 ** np.ceil(np.log2(span / cell + 1.0))) * 4
    sums = np.zeros(size)
    for share, command in parts:
        sums += np.bincount(_cells(command, c, cell), weights=share * fresh, minlength=size)
    power = np.abs(np.fft.rfft(sums)) ** 2
    rate = np.arange(power.size) / (size * cell)
    power[(rate < 3.0 / span) | (rate > 2.0 / noise)] = 0.0
    peaks, _ = find_peaks(power)
    peaks = peaks[np.argsort(power[peaks])[::-1]]
    coarse = peaks[rate[peaks] < COARSE / span]
    tried = {int(p) for p in (*peaks[:TRIED], *coarse[:TRIED])}
    best = sorted(_sharpened(fresh, parts, float(rate[p]), float(rate[1])) for p in tried)
    return tuple((1.0 / r,) for _, r in best[: -PEAKS - 1 : -1])


def _cells(values: Floats, of: Floats, cell: float) -> NDArray[np.int64]:
    return np.asarray((values - of.min()) / cell, dtype=np.int64)


def _sharpened(
    fresh: Floats, parts: Sequence[tuple[float, Floats]], rate: float, cell: float
) -> tuple[float, float]:
    """Return what rounding explains at most with a rate [1/A] within a cell, and that rate."""

    def explained(r: float) -> float:
        saw = np.zeros(len(fresh))
        for share, command in parts:
            saw += share * (np.round(r * command) / r - command)
        return float(2.0 * fresh @ saw - saw @ saw)

    return max((explained(r), r) for r in rate + cell * np.linspace(-1.0, 1.0, FINE))


def line_starts(residual: Floats, dt: float) -> tuple[tuple[float, float, float], ...]:
    """Return starting values (f [rad/s], 0, 0) of waves in time: lines in a residual's spectrum.

    Args:
        residual: Normalised residual, shape (N,).
        dt: Sample time [s].
    """
    size = 4 * len(residual)
    power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)), size)) ** 2
    width = max(power.size // 60, 3)
    usual = fftconvolve(power, np.ones(width) / width, "same")
    height = power / np.maximum(usual, 1e-12 * power.max())
    peaks, _ = find_peaks(height, height=8.0, distance=16)
    peaks = peaks[peaks >= 4 * LINE_PERIODS]
    peaks = peaks[np.argsort(height[peaks])[::-1][:PEAKS]]
    found = []
    for p in peaks:
        left, top, right = np.log(np.maximum(power[p - 1 : p + 2], 1e-300))
        bend = left - 2.0 * top + right
        fine = p + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)
        found.append((2.0 * np.pi * float(fine) / (size * dt), 0.0, 0.0))
    return tuple(found)
