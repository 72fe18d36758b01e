"""Channels that are coarser or noisier than specified: estimated from the data, not fitted.

The values of a coarse channel lie on a lattice. A noisy one scatters at high frequency and, unlike
a merely fast signal, raises the residual of its stage even where that is quietest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.recorded.noise import ChannelNoise
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.joint.kernel.arrays import Floats

COARSER = 1.8
"""Ratio of found to stated resolution above which a channel is called coarse."""
NOISIER = 1.3
"""Ratio of found to stated scatter above which a channel may be called noisy."""
RAISED = 1.15
"""Residual in the quietest windows of its stage above which it is noisy."""
OTHERS = 30.0
"""Ratio of the noise of a stage's other channels to that of one up to which its own shows."""
LOUD, EVEN = 5.0, 0.05
"""Ratio of white noise to that stated from which no stage need show it, as it may hear the channel
little or not at all, and jitter of the clock up to which it is the channel's noise, in samples."""
STAGES_OF = {
    "q_m": ("motor", "transmission"),
    "q_l": ("load", "transmission"),
    "tau": ("transmission", "load", "motor"),
    "i": (),
}
WINDOW = 100
QUIETEST = 0.25
COLOURED = 0.25
"""Correlation of neighbouring samples above which a residual is not noise."""
WHITE = 0.08
"""The same for the current, over a whole record."""
GAUSSIAN_TAILS = 3.6
"""Fourth moment over the squared second, 3 for Gaussian noise, up to which it is noise."""
GAUSSIAN = 0.925
"""Rms of the quietest quarter of windows of white Gaussian noise."""


@dataclass(frozen=True)
class SensorFinding:
    """A channel that is worse than specified."""

    name: str  # "quantization" or "noise"
    channel: str
    value: float  # resolution or standard deviation found, in the channel's unit
    low: float  # low end of its interval
    high: float  # high end of its interval
    factor: float  # how much worse than specified


def sensor_findings(setting: Setting, residuals: Mapping[str, Floats]) -> tuple[SensorFinding, ...]:
    """Return the channels that are coarser or noisier than the joint file states.

    Args:
        setting: The record.
        residuals: Normalised residuals of its stages under the specified noise.
    """
    found = []
    floors = {stage: quiet_rms(r) for stage, r in residuals.items() if stage != "drive"}
    for channel, stages in STAGES_OF.items():
        noise = setting.noise.get(channel)
        if noise is None or noise.specified == 0.0 or channel in setting.series.derived:
            continue
        stage = next((name for name in stages if name in floors), None)
        finding = _coarse(channel, noise)
        raised = stage is not None and floors[stage] > RAISED
        if stage is not None and noise.white:
            raised = raised or quiet_rms(residuals[stage], coloured=True) > RAISED
        if stage is not None and not noise.white:  # else it is a signal that is merely fast
            raised = raised and noise.observed < OTHERS * floors[stage] * noise.specified
        steady = noise.white and noise.jitter < EVEN * setting.series.dt and channel != "i"
        raised = raised or (steady and noise.observed > LOUD * noise.specified)
        if finding is None and raised:
            finding = _noisy(channel, noise, noise.observed)
        if finding is not None:
            found.append(finding)
    return tuple(found)


def with_findings(setting: Setting, findings: tuple[SensorFinding, ...]) -> Setting:
    """Return the setting with the scatter that was found."""
    noise = dict(setting.noise)
    for finding in findings:
        if finding.name == "noise" and finding.channel in noise:
            known = noise[finding.channel]
            total = float(np.hypot(finding.value, known.resolution / np.sqrt(12.0)))
            noise[finding.channel] = replace(known, std=max(known.std, total))
    return replace(setting, noise=noise)


def noisy_current(setting: Setting, residual: Floats) -> SensorFinding | None:
    """Return the finding that the current is noisy, if the residual of the drive model is noise.

    Unlike the other channels the current has no quiet windows, since its command may be as rough
    as noise. So the residual of a fitted model is tested.

    Args:
        setting: The record.
        residual: Normalised residual of the drive, shape (N,).
    """
    noise = setting.noise["i"]
    counted = residual[residual != 0.0]
    rms = float(np.sqrt(np.mean(counted**2))) if counted.size else 1.0
    if noise.specified == 0.0 or rms < RAISED:
        return None
    tails = float(np.mean(counted**4)) / rms**4
    if tails > GAUSSIAN_TAILS or abs(_memory(counted)) > WHITE:
        return None
    return _noisy("i", noise, rms * noise.specified)


def _memory(x: Floats) -> float:
    """Return the correlation of neighbouring samples."""
    return float(np.mean(x[1:] * x[:-1]) / max(float(np.mean(x * x)), 1e-300))


def quiet_rms(residual: Floats, coloured: bool = False) -> float:
    """Return the rms of a residual in its quietest windows, 1 for white Gaussian noise.

    If these windows are not white, they do not hold noise, and 1 is returned, unless `coloured`
    states that colour does not matter: a predictor tuned to less noise colours its residual.
    """
    counted = residual[residual != 0.0]
    count = len(counted) // WINDOW
    if count < 8:
        return 1.0
    windows = counted[: count * WINDOW].reshape(count, WINDOW)
    power = np.mean(windows**2, axis=1)
    few = np.argsort(power)[: max(int(QUIETEST * count), 2)]
    if not coloured and np.mean([_memory(windows[k]) for k in few]) > COLOURED:
        return 1.0
    return float(np.sqrt(power[few].mean())) / GAUSSIAN


def _coarse(channel: str, noise: ChannelNoise) -> SensorFinding | None:
    stated = max(noise.resolution, 1e-300)
    if noise.lattice > COARSER * stated and noise.lattice > 2.0 * noise.specified:
        step = noise.lattice
        factor = step / max(stated, noise.specified)
        return SensorFinding("quantization", channel, step, 0.99 * step, 1.01 * step, factor)
    return None


def _noisy(channel: str, noise: ChannelNoise, observed: float) -> SensorFinding | None:
    if not noise.stated or observed < NOISIER * noise.specified:
        return None
    own = float(np.sqrt(max(observed**2 - noise.resolution**2 / 12.0, 0.0)))
    factor = observed / noise.specified
    return SensorFinding("noise", channel, own, 0.88 * own, 1.12 * own, factor)
