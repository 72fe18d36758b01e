"""Verdict on one effect: its smallest visible size, or why it is not identifiable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps

from cjt_gym.gap.check.balance import FEWEST, Balance
from cjt_gym.gap.check.view import View
from cjt_gym.gap.digits import plain

TORQUE = 0.3
"""Upper limit on the smallest identifiable torque, relative to the driving torque."""
ABSURD = 1e9
"""Size, in the units of an effect, from which on it would be visible at none: an input that hardly
changes divides by next to nothing."""


@dataclass(frozen=True)
class Seen:
    """An effect that the record would show, with its smallest visible size."""

    size: float
    unit: str


@dataclass(frozen=True)
class Unseen:
    """An effect that the record cannot identify, why, and what to record instead."""

    why: str
    instead: str


Verdict = Seen | Unseen

NO_MOTION = Unseen(
    "nothing moves by more than its noise",
    "Record motion: drive the joint far enough that it turns by a thousand counts.",
)
TOO_FEW = Unseen(
    f"the motor moves in fewer than {FEWEST} samples",
    "Record for longer, or at a higher rate.",
)
NO_INPUT = Unseen(
    "the record has nothing that drives the joint",
    "Record the motor's current or its command.",
)


def no_balance(view: View) -> Unseen | None:
    """Return why there is no torque balance of the motor, or None if there is one."""
    if view.drive is None:
        return NO_INPUT
    if view.motor_angle is None:
        return Unseen("no motion of the motor is recorded", "Record the motor's angle q_m.")
    if view.motor is not None:
        return None
    return NO_MOTION if view.at_rest else TOO_FEW


def from_balance(judge: Callable[[View, Balance], Verdict]) -> Callable[[View], Verdict]:
    """Return a judgement from the torque balance of the motor, which fails if there is none."""

    @wraps(judge)
    def verdict(view: View) -> Verdict:
        if (none := no_balance(view)) is not None:
            return none
        assert view.motor is not None
        return judge(view, view.motor)

    return verdict


def only_from(size: float, unit: str) -> str:
    """Return a clause on the smallest size of an effect that would show.

    Example:
        >>> only_from(0.123, "N m"), only_from(0.5, "-")
        ('it would be visible only from 0.12 N m', 'it would be visible only from 50 %')
    """
    if not size < ABSURD:
        return "it would not be visible at any size"
    return f"it would be visible only from {sized(size, unit)}"


def sized(size: float, unit: str) -> str:
    """Return a size with its unit, one without a unit in percent."""
    return f"{plain(100.0 * size, 2)} %" if unit == "-" else f"{plain(size, 2)} {unit}"


def percent(share: float) -> str:
    """Return a share in percent, with two digits.

    Example:
        >>> percent(1.0), percent(0.0312)
        ('100 %', '3.1 %')
    """
    return f"{100.0 * share:.{0 if share >= 0.1 else 1}f} %"
