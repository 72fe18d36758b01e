"""Tolerances of datasheet values."""

from __future__ import annotations

import math

from cjt_gym.joint import JointFile

VAGUE = 0.3
"""Relative tolerance at or above which a value counts as a guess."""
GUESSED = 1.0
"""Standard deviation of the logarithm of a guess."""


def tolerance_of(file: JointFile, symbol: str, usual: float) -> float:
    """Return the relative deviation of a datasheet value, infinite for a guess."""
    quantity = file.parameters.quantities.get(symbol)
    if quantity is None or getattr(quantity, "guess", False):
        return math.inf
    stated = quantity.tolerance
    if stated is None:
        return math.inf if "guess" in quantity.source.lower() else usual
    return math.inf if stated >= VAGUE else max(stated, 1e-3)
