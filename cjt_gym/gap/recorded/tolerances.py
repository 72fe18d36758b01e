"""Tolerances of datasheet values."""

from __future__ import annotations

import math
from collections.abc import Mapping

from cjt_gym.joint import JointFile
from cjt_gym.joint.quantity import Quantity

VAGUE = 0.3
"""Relative tolerance at or above which a value counts as a guess."""
GUESSED = 1.0
"""Standard deviation of the logarithm of a guess."""

OUTSIDE = 3.0
"""Number of tolerances by which a value has to differ from its datasheet to count as different."""
LEVELS = "d_c"
"""Beginning of the symbols of dry friction, which no fit refines within its tolerance."""
SMOOTHING = "dq_0"


def tolerance_of(file: JointFile, symbol: str, usual: float) -> float:
    """Return the relative deviation of a datasheet value, infinite for a guess."""
    quantity = file.parameters.quantities.get(symbol)
    if quantity is None or getattr(quantity, "guess", False):
        return math.inf
    stated = quantity.tolerance
    if stated is None:
        return math.inf if "guess" in quantity.source.lower() else usual
    return math.inf if stated >= VAGUE else max(stated, 1e-3)


def is_left_open(file: JointFile, effect: str, values: Mapping[str, float]) -> bool:
    """Return whether an effect is no more than values that a datasheet leaves open."""
    levels = {symbol: value for symbol, value in values.items() if symbol != SMOOTHING}
    return bool(levels) and all(_is_open(file, effect, *level) for level in levels.items())


def _is_open(file: JointFile, effect: str, symbol: str, value: float) -> bool:
    """Return whether a value is guessed, or a level of dry friction within its tolerance."""
    entry = file.effects.get(effect, {}).get(symbol)
    known = entry if isinstance(entry, Quantity) else file.parameters.quantities.get(symbol)
    if known is None or known.guess:
        return known is not None
    if not symbol.startswith(LEVELS) or not known.tolerance or min(value, known.number) <= 0.0:
        return False
    return abs(math.log(value / known.number)) <= OUTSIDE * known.tolerance
