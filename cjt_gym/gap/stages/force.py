"""The drive torque that a joint without a spring needs for its measured motion.

Without a spring to ground the position of a replay integrates all its errors and ranks models
wrongly. The torque that a model needs does not drift: its inertia times the measured acceleration
plus its friction along the measured motion. It is compared with the applied torque; both pass the
same low-pass filter, forwards and backwards.

References:
    Gautier, M. (1997), Dynamic identification of robots with power model, ICRA: inverse dynamics
    and parallel filtering.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, sosfiltfilt

from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.recorded.signals import motor_torque, periodic_torque, smooth_mean, weight
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.joint.kernel.arrays import Floats

CUTOFF, SHARE = 100.0, 0.2
"""Highest cut-off of the filter [Hz], and its largest share of the sampling frequency."""
LOWEST = 2.0
"""Lowest cut-off [Hz]."""
PART = 0.05
"""Largest rms of the noise in the compared torques, as a share of the torque."""
ORDER = 4
PERIODS = 2.0
"""Settling time of the filter at an end of a record, in periods of its cut-off."""


def torques(setting: Setting, fields: Fields) -> tuple[Floats, Floats]:
    """Return the applied torque and the one that the model needs [N m], each of shape (M,).

    The ends of the record are left out, where the filter knows the motion on one side only: a
    record that begins or ends in motion would appear to need a jerk there.
    """
    series, dt = setting.series, setting.series.dt
    cutoff = fair_cutoff(setting)
    stages = Stages(setting)
    stages.tune(fields)
    friction = stages.predict("motor", fields).friction.sum(axis=1)
    current = motor_torque(fields, series) - fields["offset"]
    q = series["q_m"]
    outside = periodic_torque(fields, q, np.zeros(len(q))) - weight(fields, q)
    if "tau_l" in series:
        outside = outside + series["tau_l"]
    known = friction + smooth_mean(outside) + fields["offset"]
    speed = np.gradient(low_pass(q, dt, cutoff), dt)
    inertia = sum(fields[f"I_{b}"] for b in "mgl")
    damping = sum(fields[f"d_{b}"] for b in "mgl")
    needed = inertia * np.gradient(speed, dt) + damping * speed
    applied = low_pass(_centred(current), dt, cutoff)
    inner = slice(end := _memory(len(q), dt, cutoff), len(q) - end)
    return applied[inner], (needed - low_pass(_centred(known), dt, cutoff))[inner]


def _memory(samples: int, dt: float, cutoff: float) -> int:
    """Return the number of samples at an end of a record that the filter distorts."""
    return min(round(PERIODS / (cutoff * dt)), samples // 10)


def fair_cutoff(setting: Setting) -> float:
    """Return the highest cut-off [Hz] at which noise is no more than a small part of the torque."""
    size = float(np.sqrt(np.mean(motor_torque(setting.nominal, setting.series) ** 2)))
    cutoff = min(CUTOFF, SHARE / setting.series.dt)
    while cutoff > LOWEST and torque_noise(setting, cutoff) > PART * size:
        cutoff *= 0.7
    return cutoff


def _centred(torque: Floats) -> Floats:
    """Return the mean of the intervals before and after each sample."""
    return np.asarray(0.5 * (torque + np.concatenate([torque[:1], torque[:-1]])))


def low_pass(x: Floats, dt: float, cutoff: float) -> Floats:
    """Return a signal low-pass filtered at a cut-off [Hz], shape (N,)."""
    sos = butter(ORDER, cutoff, fs=1.0 / dt, output="sos")
    return np.asarray(sosfiltfilt(sos, x))


def torque_noise(setting: Setting, cutoff: float) -> float:
    """Return the error of the torque [N m] that noise of encoder and current alone would leave."""
    fields = setting.nominal
    rng, dt = np.random.default_rng(0), setting.series.dt
    white = rng.standard_normal((2, max(len(setting.series), 1000)))
    inertia = sum(fields[f"I_{b}"] for b in "mgl")
    shaken = setting.noise["q_m"].jitter * float(np.std(setting.series.speed("q_m")))
    angle = float(np.hypot(setting.std("q_m"), shaken)) * white[0]
    moved = np.gradient(np.gradient(low_pass(angle, dt, cutoff), dt), dt)
    current = fields["n"] * fields["k_t"] * setting.std("i") * low_pass(white[1], dt, cutoff)
    return float(np.hypot(inertia * np.std(moved), np.std(current)))
