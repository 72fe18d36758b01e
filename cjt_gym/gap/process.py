"""Torque noise of a drive that nothing specifies, read off the record.

Where a joint file states the noise of the measured current, the torque that is uncertain follows
from it. Elsewhere the record itself must tell how closely a perfect model could predict: its
innovations in the quietest stretches of motion, less a straight line over each, which is what a
wrong model leaves there. The deviation of white torque noise that makes these most likely counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cjt_gym.gap.fields import Fields
    from cjt_gym.gap.stages import Stages

Floats = NDArray[np.float64]
WINDOW = 32
"""Samples of a stretch."""
QUIET = 0.25
QUIET_POWER = 0.87
"""Quantile of the stretches' powers that counts, and what it is for white noise of power 1."""
MOVING = 0.2
"""Least mean velocity of a stretch, as a share of the rms velocity: a joint at rest is no test."""
FEWEST = 8
COLOUR = 1.4
"""Factor by which torques that are not modelled, and not white, raise the residual of a good model
of a real drive."""
SMALL = 0.05
"""Share of the gap, in rms, below which it is left to such torques."""
OCTAVES = 24
"""Range that is searched, downwards from noise that leaves nothing of the prediction."""


def process_torque(stages: Stages, fields: Fields) -> float:
    """Return the deviation of white torque noise on the motor, per sample [N m].

    Args:
        stages: The record; its gains are left tuned to the noise found.
        fields: The nominal joint.
    """
    s = stages.setting
    inertia = sum(
        fields[f"I_{b}"] for b, g in zip("mgl", s.structure.groups, strict=True) if g == 0
    )
    strongest = 16.0 * inertia * s.std("q_m") / s.series.dt**2
    best, worst = 0.0, np.inf
    for octave in range(OCTAVES):
        stages.process = strongest * 0.5**octave
        stages.tune(fields)
        std = float(stages.gains["motor"].std[0])
        power = quiet_power(stages.residual("motor", fields), s.series.speed("q_m"))
        cost = 2.0 * np.log(std) + power
        if cost < worst:
            best, worst = stages.process, cost
    stages.process = best
    stages.tune(fields)
    return best


def allow_for_colour(stages: Stages, mean_square: float) -> None:
    """Widen the scatter of the motor's residual by what no model of a real drive explains.

    Args:
        stages: The record, with the process torque of its white noise.
        mean_square: Of the motor's residual without any effect.
    """
    stages.allowance = max(COLOUR, SMALL * mean_square**0.5)


def quiet_power(residual: Floats, speed: Floats) -> float:
    """Return the power of a residual in its quiet stretches of motion, 1 for white noise of std 1.

    Args:
        residual: Normalised residual, shape (N,).
        speed: Velocity at its samples, shape (N,).
    """
    count = len(residual) // WINDOW
    pieces = residual[: count * WINDOW].reshape(count, WINDOW)
    moving = np.abs(speed[: count * WINDOW].reshape(count, WINDOW).mean(axis=1))
    chosen = moving > MOVING * float(np.sqrt(np.mean(speed**2)))
    if np.count_nonzero(chosen) >= FEWEST:
        pieces = pieces[chosen]
    k = np.arange(WINDOW) - 0.5 * (WINDOW - 1)
    slope = pieces @ k / (k @ k)
    flat = pieces - pieces.mean(axis=1, keepdims=True) - slope[:, None] * k
    power = np.sum(flat**2, axis=1) / (WINDOW - 2)
    return float(np.quantile(power, QUIET)) / QUIET_POWER
