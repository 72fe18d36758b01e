"""Uncertainty of datasheet values."""

from __future__ import annotations

import math

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.model import Term, body_group
from cjt_gym.gap.recorded.tolerances import GUESSED, tolerance_of
from cjt_gym.joint import Joint, JointFile


def stated_tolerance(joint: Joint, term: Term) -> float | None:
    """Return the relative deviation stated by a datasheet, or None.

    For the inertia it is that of all bodies that move with the motor.
    """
    moving = [f"I_{b}" for b in body_group(joint.structure_row, "m")]
    symbols = moving if term.name == "inertia" else [term.numbers[0].symbol]
    known = joint.parameters.quantities
    parts = [known[s] for s in symbols if s in known and known[s].number > 0.0]
    if not parts or any(q.tolerance is None for q in parts):
        return None
    total = sum(q.number for q in parts)
    return math.sqrt(sum((q.number * (q.tolerance or 0.0)) ** 2 for q in parts)) / total


def datasheet_number(file: JointFile, symbol: str, usual: float, reach: float) -> Number:
    """Return a datasheet value as a free number with its tolerance."""
    quantity = file.parameters.quantities[symbol]
    tolerance = tolerance_of(file, symbol, usual)
    vague = not math.isfinite(tolerance)
    start = quantity.number
    return Number(
        symbol, quantity.unit, start, GUESSED if vague else tolerance, True,
        start / reach, start * reach, True,
    )  # fmt: skip


def inertias_at(joint: Joint, factor: float) -> dict[str, float]:
    """Return the inertias of all bodies that move with the motor if their sum is off by a factor.

    Guesses change; if there is none, the rotor's does, or all in proportion if that is too small.
    """
    own = {
        f"I_{b}": joint.parameters.get(f"I_{b}", 0.0) for b in body_group(joint.structure_row, "m")
    }
    open_ = {s: x for s, x in own.items() if not math.isfinite(tolerance_of(joint.file, s, 0.0))}
    changed = {s: x for s, x in open_.items() if x > 0.0} or {"I_m": own["I_m"]}
    rest = factor * sum(own.values()) - sum(x for s, x in own.items() if s not in changed)
    if rest <= 0.0:
        return {s: x * factor for s, x in own.items()}
    return own | {s: x * rest / sum(changed.values()) for s, x in changed.items()}
