"""The sensors: from the state to the measured channels."""

from __future__ import annotations

import math

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.plant import Floats, Sensing
from cjt_gym.blind.state import CURRENT, Q


@jit
def clean_channels(s: Sensing, x: Floats, tau: float, t: float, out: Floats) -> None:
    """Write the readings of noise-free electronics, with all systematic effects; shape (5,)."""
    hum = math.sin(2.0 * math.pi * s.hum_f * t + s.hum_phase)
    out[0] = x[CURRENT] + s.hum * hum
    out[1] = x[Q] + s.ecc_m * math.sin(s.ecc_m_f * x[Q] + s.ecc_phase)
    out[2] = x[Q + 1]
    out[3] = x[Q + 2] + s.ecc_l * math.sin(x[Q + 2] + s.ecc_phase)
    drift = s.drift * (1.0 - math.exp(-t / s.drift_time))
    out[4] = s.gain * tau + s.bias + s.crosstalk * x[CURRENT] + drift


@jit
def measure(
    s: Sensing, clean: Floats, noise: Floats, resolution: Floats, shift: float, out: Floats
) -> None:
    """Write the measurements: calibration errors, lost counts, noise, rounding; shape (5,)."""
    zeros = (s.zero_i, s.zero_m, s.zero_g, s.zero_l, s.zero_tau)
    for channel in range(5):
        value = clean[channel] + zeros[channel] + noise[channel]
        if channel == 1:
            value += shift
        if resolution[channel] > 0.0:
            value = resolution[channel] * math.floor(value / resolution[channel] + 0.5)
        out[channel] = value
