"""Channels that are coarser or noisier than specified: read off the data, not fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.noise import ChannelNoise
from cjt_gym.gap.setting import Setting

COARSER = 1.8
"""Factor between found and stated resolution from which a channel is called coarse."""
NOISIER = 1.5
"""Factor between found and stated scatter from which a channel is called noisy."""
MEASURED = ("i", "q_m", "q_l", "tau")


@dataclass(frozen=True)
class SensorFinding:
    """A channel that is worse than specified.

    Attributes:
        name: "quantization" or "noise".
        channel: Its name.
        value: Resolution or standard deviation found, in the channel's unit.
        low: Low end of its interval.
        high: High end of its interval.
        factor: How much worse than specified.
    """

    name: str
    channel: str
    value: float
    low: float
    high: float
    factor: float


def sensor_findings(setting: Setting) -> tuple[SensorFinding, ...]:
    """Return the channels that are coarser or noisier than the joint file states."""
    found = []
    for channel in MEASURED:
        noise = setting.noise.get(channel)
        if noise is None or noise.specified == 0.0:
            continue
        finding = _coarse(channel, noise) or _noisy(channel, noise)
        if finding is not None:
            found.append(finding)
    return tuple(found)


def _coarse(channel: str, noise: ChannelNoise) -> SensorFinding | None:
    stated = max(noise.resolution, 1e-300)
    if noise.lattice > COARSER * stated and noise.lattice > 2.0 * noise.specified:
        step = noise.lattice
        return SensorFinding("quantization", channel, step, 0.99 * step, 1.01 * step, step / stated)
    return None


def _noisy(channel: str, noise: ChannelNoise) -> SensorFinding | None:
    """Return the finding where the scatter in quiet windows exceeds what is specified."""
    if channel == "i":  # its command may be noise itself: what the drive's model leaves tells
        return None
    if noise.observed < NOISIER * noise.specified:
        return None
    own = float(np.sqrt(max(noise.observed**2 - noise.resolution**2 / 12.0, 0.0)))
    return SensorFinding(
        "noise", channel, own, 0.9 * own, 1.1 * own, noise.observed / noise.specified
    )
