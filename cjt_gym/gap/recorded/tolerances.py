"""Tolerances of datasheet values."""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Mapping

from cjt_gym.joint import EFFECTS, JointFile
from cjt_gym.joint.effects.friction import DRY
from cjt_gym.joint.files.quantity import Quantity

VAGUE = 0.3
"""Relative tolerance at or above which a value counts as a guess."""
GUESSED = 1.0
"""Standard deviation of the logarithm of a guess."""

OUTSIDE = 3.0
"""Number of tolerances by which a value has to differ from its datasheet to count as different."""
FAR = 1.5
"""The same from which a value within its tolerance is worth a word."""
LEAST = 0.01
"""Relative deviation that an identified value always has: sensors are no better."""
SMOOTHING = "dq_0"
ASSUMED = {"k_t": 0.02, "I": 0.05, "k": 0.05, "d": 0.3}
"""Relative tolerances of values that state none, by symbol or its first letter."""
OF_TORQUE = ("k_t", "k_b", "k_g", "I_", "d_")
"""Beginnings of the symbols of values that scale with the torque."""


def tolerance_of(file: JointFile, symbol: str, usual: float) -> float:
    """Return the relative deviation of a datasheet value, infinite for a guess."""
    quantity = file.parameters.quantities.get(symbol)
    if quantity is None or getattr(quantity, "guess", False):
        return math.inf
    stated = quantity.tolerance
    if stated is None:
        return math.inf if "guess" in quantity.source.lower() else usual
    return math.inf if stated >= VAGUE else max(stated, 1e-3)


def assumed_tolerance(symbol: str) -> float:
    """Return the relative tolerance that a datasheet value has if it states none."""
    return ASSUMED.get(symbol, ASSUMED.get(symbol[0], 0.05))


def common_deviation(file: JointFile, *, cut: bool, but: Collection[str] = ()) -> float:
    """Return the relative deviation of what a torque sensor of unknown scale leaves open.

    If it reads too much, all values that a torque is a part of are found too large by one factor,
    which no record shows: the tolerances of the datasheet alone limit it.

    Args:
        file: The datasheet.
        cut: Whether a measured torque cuts the joint into stages.
        but: Symbols of values that are not as the datasheet states.
    """
    known = [
        q.tolerance
        for symbol, q in file.parameters.quantities.items()
        if symbol.startswith(OF_TORQUE) and q.tolerance and not q.guess and symbol not in but
    ]
    return 1.0 / math.sqrt(sum(x**-2 for x in known)) if cut and known else 0.0


def is_torque(unit: str) -> bool:
    """Return whether numbers of a unit are in proportion to the scale of all torques."""
    return unit.startswith(("N", "kg"))


def stated(file: JointFile, effect: str, symbol: str) -> Quantity | None:
    """Return what a joint file states of a number of an effect, there or among the parameters."""
    entry = file.effects.get(effect, {}).get(symbol)
    return entry if isinstance(entry, Quantity) else file.parameters.quantities.get(symbol)


def unlisted(file: JointFile, found: JointFile, named: Collection[str]) -> list[str]:
    """Return a remark on dry friction that a joint has as its datasheet states, but does not list.

    Args:
        file: The datasheet.
        found: The joint that was found.
        named: Names of the effects that a diagnosis tells.
    """
    if DRY & (file.effects.keys() | {*named}):
        return []
    given = {s for name in DRY & found.effects.keys() for s in found.effects[name]}
    symbols = sorted(given & file.parameters.quantities.keys() - {SMOOTHING})
    if not symbols:
        return []
    return [
        f"The joint file states {', '.join(symbols)} but lists no dry friction, so that its "
        "simulation has none, while this diagnosis assumes it. Add [effects.coulomb] to the file."
    ]


def unnamed(file: JointFile, found: JointFile, named: Collection[str]) -> list[str]:
    """Return a remark on each effect of the drive that a joint has without a name.

    Args:
        file: The datasheet.
        found: The joint that was found.
        named: Names of the effects that a diagnosis tells.
    """
    said = []
    for name in sorted(found.effects.keys() - file.effects.keys() - {*named}):
        number = next((x for x in found.effects[name].values() if isinstance(x, Quantity)), None)
        if EFFECTS[name].stage == "drive" and number is not None:
            said.append(
                f"joint.toml contains {name} ({number.number:.2g} {number.unit}), because the "
                "motion is then predicted best: the log may hold the input early, or the sensors "
                "may be late. It is not named, as this record does not show which."
            )
    return said


def strained(file: JointFile, found: JointFile, named: Collection[str]) -> list[str]:
    """Return sentences on values that moved far, though within what counts as their datasheet's.

    Args:
        file: The datasheet.
        found: The joint that was found.
        named: Symbols whose values a diagnosis tells.
    """
    moved: dict[str, list[str]] = {}
    for symbol, old in file.parameters.quantities.items():
        new = found.parameters.quantities.get(symbol)
        if new is None or symbol in named or old.guess or not old.number:
            continue
        tolerance = old.tolerance or assumed_tolerance(symbol)
        far = abs(new.number / old.number - 1.0) / tolerance
        # of a stated tolerance that a value has left, another word is said if it is no guess
        told = far <= OUTSIDE or tolerance >= VAGUE or not old.tolerance
        if far > FAR and told:
            times = f"{FAR:g} to {OUTSIDE:g}" if far <= OUTSIDE else f"more than {OUTSIDE:g}"
            whose = "the datasheet's" if old.tolerance else "the assumed"
            value = f"{symbol} {new.number:.3g} {old.unit} for {old.number:.3g}"
            moved.setdefault(f"Refined by {times} times {whose} tolerance", []).append(value)
    return [f"{how}: {', '.join(said)}." for how, said in sorted(moved.items())]


def listed_values(file: JointFile) -> frozenset[str]:
    """Return the symbols that listed effects give a value, whatever a datasheet guesses of them."""
    rows = [row.items() for row in file.effects.values()]
    return frozenset(s for row in rows for s, x in row if isinstance(x, Quantity) and not x.guess)


def is_left_open(file: JointFile, effect: str, values: Mapping[str, float]) -> bool:
    """Return whether an effect is no more than values that a datasheet leaves open.

    Dry friction that a joint file states but does not list is no such value: its simulation has
    none.
    """
    if effect in DRY and not DRY & file.effects.keys():
        return False
    if effect == "gravity" and effect in file.effects:
        return _is_listed_weight(file.effects[effect], values)
    levels = {symbol: value for symbol, value in values.items() if symbol != SMOOTHING}
    return bool(levels) and all(_is_open(file, effect, *level) for level in levels.items())


def _is_open(file: JointFile, effect: str, symbol: str, value: float) -> bool:
    """Return whether a value is guessed, is listed, or is within its tolerance."""
    entry, known = file.effects.get(effect, {}).get(symbol), stated(file, effect, symbol)
    if isinstance(entry, Quantity) and _is_listed(entry, value):
        return True
    if known is None or known.guess:
        return known is not None
    if not known.tolerance or min(value, known.number) <= 0.0:
        return False
    ratio = value / known.number
    return max(abs(math.log(ratio)), abs(ratio - 1.0)) <= OUTSIDE * known.tolerance


def _is_listed_weight(entries: Mapping[str, object], values: Mapping[str, float]) -> bool:
    """Return whether a weight is the listed one within its tolerance, or corrects a guess."""
    torque, angle = entries.get("torque"), entries.get("angle")
    if not isinstance(torque, Quantity):
        return False
    if torque.guess:
        return True
    low, high = (x if isinstance(x, float) else torque.number for x in (torque.low, torque.high))
    reach = max(OUTSIDE * (torque.tolerance or LEAST) * torque.number, 0.5 * (high - low))
    turned = values["angle"] - (angle.number if isinstance(angle, Quantity) else 0.0)
    off = values["torque"] * cmath.exp(1j * turned) - torque.number
    return abs(off) <= reach


def _is_listed(entry: Quantity, value: float) -> bool:
    """Return whether a value is the one that a joint file lists, as well as it is known."""
    if isinstance(entry.value, tuple):
        return False
    low, high = (x if isinstance(x, float) else entry.value for x in (entry.low, entry.high))
    return low <= value <= high or abs(value - entry.value) <= LEAST * abs(entry.value)
