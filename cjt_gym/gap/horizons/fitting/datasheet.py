"""Uncertainty of datasheet values."""

from __future__ import annotations

import math

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.gap.recorded.tolerances import GUESSED, tolerance_of
from cjt_gym.gap.stages.intervals import TENFOLD
from cjt_gym.joint import Joint, JointFile

SPARED = 0.1
"""Guesses, or the rotor, change alone until this share of their value in proportion is left."""


def stated_tolerance(joint: Joint, term: Term) -> float | None:
    """Return the relative deviation stated by a datasheet, or None.

    For inertia and damping it is that of all bodies that move with the motor.
    """
    symbol = term.numbers[0].symbol
    moving = [f"{symbol[:2]}{b}" for b in body_group(joint.structure_row, "m")]
    symbols = moving if symbol in ("I_m", "d_m") else [symbol]
    known = joint.parameters.quantities
    parts = [known[s] for s in symbols if s in known and known[s].number > 0.0]
    if not parts or any(q.tolerance is None for q in parts):
        return None
    total = sum(q.number for q in parts)
    return math.sqrt(sum((q.number * (q.tolerance or 0.0)) ** 2 for q in parts)) / total


def datasheet_number(file: JointFile, symbol: str, usual: float, reach: float) -> Number:
    """Return a datasheet value as a free number with its tolerance; a guess reaches further."""
    quantity = file.parameters.quantities[symbol]
    tolerance = tolerance_of(file, symbol, usual)
    vague = not math.isfinite(tolerance)
    start, reach = quantity.number, max(reach, TENFOLD) if vague else reach
    return Number(
        symbol, quantity.unit, start, GUESSED if vague else tolerance, True,
        start / reach, start * reach, True,
    )  # fmt: skip


def inertias_at(joint: Joint, factor: float) -> dict[str, float]:
    """Return the inertias of all bodies that move with the motor if their sum is off by a factor.

    Guesses change; if there is none, the rotor's does. The others follow only
    once little of these is left.
    """
    own = {
        f"I_{b}": joint.parameters.get(f"I_{b}", 0.0) for b in body_group(joint.structure_row, "m")
    }
    there = [s for s, x in own.items() if x > 0.0]
    guessed = [s for s in there if not math.isfinite(tolerance_of(joint.file, s, 0.0))]
    changed = guessed or there[:1]
    moved = sum(own[s] for s in changed)
    others = sum(own.values()) - moved
    total = factor * (moved + others)
    new = max(total - others, SPARED * factor * moved)
    kept = (total - new) / others if others > 0.0 else 1.0
    return {s: x * (new / moved if s in changed else kept) for s, x in own.items()}
