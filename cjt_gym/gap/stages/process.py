"""Unspecified noise of a drive, estimated from the record: of its torque and of its clock.

Where a joint file states the noise of the measured current, the torque that is uncertain follows
from it. Elsewhere the record itself must tell how closely a perfect model could predict: its
innovations in the quietest stretches of motion, less a straight line over each, which is what a
wrong model leaves there. The deviations of white torque noise and of the sampling times, whose
share grows with velocity, that make these most likely count.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cjt_gym.gap.recorded.setting import as_noisy
from cjt_gym.gap.recorded.signals import motor_torque
from cjt_gym.joint.kernel.arrays import Floats

if TYPE_CHECKING:
    from cjt_gym.gap.recorded.fields import Fields
    from cjt_gym.gap.stages.cut import Stages

WINDOW = 32
"""Samples of a stretch."""
QUIET = 0.25
QUIET_POWER = 0.87
"""Quantile of the stretches' powers that counts, and what it is for white noise of power 1."""
MOVING = 0.05
"""Smallest mean velocity of a stretch as a share of the rms velocity; rest is no test."""
CLASSES = 4
"""Classes of velocity whose quiet stretches count alike."""
FEWEST = 8
COLOUR = 1.4
"""Factor by which unmodelled coloured torques raise the residual of a good model of a real
drive."""
SMALL = 0.05
"""Share of the gap, in rms, below which it is attributed to such torques."""
MOST = 0.05
"""Largest torque noise, as a share of the drive's rms torque: a larger one would hide any gap."""
OCTAVES = 16
"""Search range, downwards from noise that makes the prediction worthless."""
SHAKES = (0.0, *(0.5**k for k in range(2, 11)))
"""Sampling jitters that are tried, in samples."""


def settle_noise(stages: Stages, fields: Fields) -> None:
    """Set the torque noise and, where it is not specified, the jitter of the clock.

    Several records share the noise of the first.
    """
    others, stages.others = stages.others, ()
    s = stages.setting
    inertia = sum(
        fields[f"I_{b}"] for b, g in zip("mgl", s.structure.groups, strict=True) if g == 0
    )
    drive = motor_torque(fields, s.series)
    strongest = min(
        16.0 * inertia * s.std("q_m") / s.series.dt**2,
        MOST * float(np.sqrt(np.mean(drive**2))),
    )
    torques = [strongest * 0.5**octave for octave in range(OCTAVES)]
    speed = s.series.speed("q_m")

    def cost(torque: float, shake: float) -> float:
        _set(stages, torque, shake)
        stages.tune(fields)
        scatter = stages.gains["motor"].scatter
        raw = stages.residual("motor", fields) * scatter
        return misfit(raw, scatter, speed)

    shakes = [s.noise["q_m"].jitter]
    if "jitter" not in s.joint.sampling:
        shakes = [k * s.series.dt for k in SHAKES]
    torque, shake = strongest, shakes[0]
    for _ in range(2 if len(shakes) > 1 else 1):
        torque = min(torques, key=partial(cost, shake=shake))
        shake = min(shakes, key=partial(cost, torque))
    _set(stages, torque, shake)
    stages.others = others
    for other in others:
        other.setting = as_noisy(other.setting, stages.setting)


def _set(stages: Stages, torque: float, shake: float) -> None:
    noise = dict(stages.setting.noise)
    noise["q_m"] = replace(noise["q_m"], jitter=shake)
    stages.setting = replace(stages.setting, noise=noise, process=torque)


def allow_for_colour(stages: Stages, mean_square: float) -> None:
    """Widen the scatter of the motor's residual by the share no model of a real drive explains.

    The mean square is that of the motor's residual without any effect.
    """
    allowance = max(COLOUR, SMALL * mean_square**0.5)
    for each in (stages, *stages.others):
        each.setting = replace(each.setting, allowance=allowance)


def misfit(raw: Floats, scatter: Floats, speed: Floats) -> float:
    """Return twice the mean negative log likelihood of innovations in quiet stretches of motion.

    Args:
        raw: Innovations, shape (N,).
        scatter: Their deviation, shape (N,).
        speed: Velocity at the samples, shape (N,).
    """
    count = len(raw) // WINDOW
    pieces, widths, speeds = (
        x[: count * WINDOW].reshape(count, WINDOW) for x in (raw, scatter, speed)
    )
    k = np.arange(WINDOW) - 0.5 * (WINDOW - 1)
    slope = pieces @ k / (k @ k)
    flat = pieces - pieces.mean(axis=1, keepdims=True) - slope[:, None] * k
    power = np.sum(flat**2, axis=1) / (WINDOW - 2)
    variance = np.mean(widths**2, axis=1)
    mean = np.abs(speeds.mean(axis=1))
    moving = mean > MOVING * float(np.sqrt(np.mean(speed**2)))
    order = np.flatnonzero(moving) if np.count_nonzero(moving) >= FEWEST else np.arange(count)
    order = order[np.argsort(mean[order])]
    total = 0.0
    for some in np.array_split(order, CLASSES if len(order) >= CLASSES * FEWEST else 1):
        ratio = float(np.quantile(power[some] / variance[some], QUIET)) / QUIET_POWER
        total += float(np.mean(np.log(variance[some]))) + ratio
    return total
