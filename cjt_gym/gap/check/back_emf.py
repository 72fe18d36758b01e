"""A voltage against what the motor induces at its speed."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.check.view import View

BEYOND = 8.0
"""Ratio of the induced voltage to the largest applied from which a unit is wrong. Of 46 real
records by voltage five have more than 1.2, and the most is 5.2."""


def faster_than_driven(view: View) -> list[str]:
    """Return a sentence on a motor that runs far faster than its voltage could drive it."""
    if view.drive != "v" or view.motor is None or not view.value("r"):
        return []
    volts = max(float(np.abs(piece["v"]).max()) for piece in view.stretches)
    speed = float(np.quantile(np.abs(view.motor["v"]), 0.95))
    induced = view.value("k_t") * view.ratio * speed
    if volts == 0.0 or induced <= BEYOND * volts:
        return []
    return [
        f"At {speed:.3g} {view.angle_unit}/s the motor induces {induced:.3g} V, and no voltage of "
        f"the record exceeds {volts:.3g} V: a unit (of v, of the motion, or of k_t) is wrong."
    ]
