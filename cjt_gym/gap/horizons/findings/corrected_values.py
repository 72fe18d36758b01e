"""Values of a datasheet that a fit corrects, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.candidates.nuisances import USUAL_COMMAND, USUAL_CURRENT
from cjt_gym.gap.diagnosis import NamedEffect, told_symbols
from cjt_gym.gap.digits import plain
from cjt_gym.gap.horizons.fitting.datasheet import stated_tolerance
from cjt_gym.gap.horizons.fitting.fit import Fit
from cjt_gym.gap.horizons.prediction.model import Term, motor_inertia
from cjt_gym.gap.horizons.selection.judgement import LOUD, Judgement
from cjt_gym.gap.horizons.torque.inverse import inverse
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.gap.recorded.tolerances import OUTSIDE, VAGUE, listed_values, stated
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.files.effect_entries import unit_on

HEAVY = 10.0
"""Multiple of the inertia of datasheet and regressions at or above which it is not realistic."""
REFINED = 0.1
"""Relative difference above which a refined value is reported."""
NAMELESS = "No cause is named; refined values predict better:"
BESIDE = "Refined values predict better:"
"""What introduces values that differ from the datasheet without and beside a cause."""
LATE = frozenset({"command_delay", "current_lag"})
"""Effects that cannot be separated from slow mechanics without a measured current."""


def corrected(judged: Judgement) -> str:
    """Return sentences on the guesses of the datasheet that the answer corrects."""
    said, file = [], judged.case.joint.file
    guesses = {s: q for s, q in file.parameters.quantities.items() if q.guess}
    known = {s: (q, _given(judged, s)) for s, q in guesses.items() if s not in listed_values(file)}
    weight = stated(file, "gravity", "torque")
    if weight is not None and weight.guess and "gravity" in judged.joint.effects:
        size = float(judged.joint.effects["gravity"]["torque"])  # type: ignore[arg-type]
        known["the weight"] = weight, size
    for symbol, (quantity, new) in known.items():
        if abs(new - quantity.number) > REFINED * max(abs(new), abs(quantity.number)):
            said.append(
                f"The guess of {symbol}, {plain(quantity.number)} {quantity.unit}, is corrected to "
                f"{plain(new)}.{_far_from(symbol, quantity.number, new)}"
            )
    return " ".join(said)


def _far_from(symbol: str, guess: float, new: float) -> str:
    """Return what to check where a guess is off by more than guesses are, "" if it is not.

    Of damping and friction hardly more than the order of magnitude is ever known.
    """
    ratio = new / guess if guess else 1.0
    far = max(ratio, 1.0 / ratio) if ratio > 0.0 else 1.0
    if far < HEAVY or not symbol.startswith(("I_", "k_")):
        return ""
    return f" That is a factor of {plain(far, 2)}: check units, gear ratio and torque constant."


def moving_together(judged: Judgement, effects: Sequence[NamedEffect]) -> str:
    """Return a sentence on the inertia of several bodies that move as one, if one is named.

    The record shows only their sum; an effect has a single inertia.
    """
    nominal = judged.case.joint
    own = [f"I_{b}" for b in body_group(nominal.structure_row, "m")]
    parts = [s for s in own if nominal.parameters.get(s, 0.0) > 0.0]
    if len(parts) < 2 or not any(e.name == "inertia" for e in effects):
        return ""
    old, new = motor_inertia(nominal), sum(_given(judged, s) for s in parts)
    unit = nominal.parameters.quantities[parts[0]].unit
    return (
        f"What moves as one has an inertia of {plain(new)} {unit} instead of {plain(old)}; "
        f"the record does not tell how {' and '.join(parts)} share it."
    )


@dataclass(frozen=True)
class LeftTolerance:
    """A stated value, or the sum of several, that left its tolerance.

    Attributes:
        symbols: Its symbols.
        stated: What the datasheet states.
        value: What fits best.
        spread: Relative tolerance.
        unit: Unit of both values.
    """

    symbols: tuple[str, ...]
    stated: float
    value: float
    spread: float
    unit: str


def left_tolerance(judged: Judgement, effects: Sequence[NamedEffect]) -> list[LeftTolerance]:
    """Return the stated values that no effect names and that left their tolerance.

    Bodies that move as one count together.
    """
    nominal = judged.case.joint
    named = told_symbols(effects)
    moving = tuple(f"I_{b}" for b in body_group(nominal.structure_row, "m"))
    known = nominal.parameters.quantities
    found = []
    alone = [(s,) for s in ("k_t", "k_b", "k_g", "I_l") if s not in moving]
    for symbols in (moving, *alone):
        parts = {s: known[s] for s in symbols if s in known and known[s].number > 0.0}
        if not parts or named & {*symbols} or any(not q.tolerance for q in parts.values()):
            continue
        old, new = sum(q.number for q in parts.values()), sum(_given(judged, s) for s in parts)
        spread = math.hypot(*(q.number * (q.tolerance or 0.0) for q in parts.values())) / old
        if abs(math.log(max(new, 1e-12 * old) / old)) > OUTSIDE * spread:
            unit = next(iter(parts.values())).unit
            found.append(LeftTolerance(tuple(parts), old, new, spread, unit))
    return found


def gave_way(judged: Judgement, effects: Sequence[NamedEffect]) -> str:
    """Return a sentence on the values that `left_tolerance`."""
    left = left_tolerance(judged, effects)
    said = [
        f"{' + '.join(one.symbols)} = {plain(one.value)} {one.unit} for {plain(one.stated)} within "
        f"{plain(100.0 * one.spread, 2)} %"
        for one in left
    ]
    if not said:
        return ""
    geared = judged.case.joint.parameters.n != 1.0 and any("k_t" in one.symbols for one in left)
    such = ", such as the gear ratio n," if geared else ""
    return (
        f"What fits best leaves the datasheet's tolerance: {', '.join(said)}. If another value of "
        f"the datasheet{such} is off instead, the sizes named here change with it."
    )


def _given(judged: Judgement, symbol: str) -> float:
    """Return a value of the joint that is the answer, from its effects or its parameters.

    Levels of dry friction are the sum of those of all its laws.
    """
    nominal, answer = judged.case.joint, judged.joint
    every = [x for values in answer.effects.values() if isinstance(x := values.get(symbol), float)]
    if symbol.startswith("d_c") and every:
        return sum(every)
    rows = [values for name, values in answer.effects.items() if name not in nominal.effects]
    known = [x for values in rows if isinstance(x := values.get(symbol), float)]
    return known[0] if known else answer.parameters.get(symbol, nominal.parameters.get(symbol, 0.0))


def refined(judged: Judgement, *, known: bool = False) -> str:
    """Return a sentence on values that differ from the datasheet though no effect is named.

    There is none on those of a joint that the torque hardly moves.

    Args:
        judged: The judgement.
        known: Whether to skip values that have a datasheet prior, guesses included, and those
            that no error shows to be off, unless they left a stated tolerance by far.
    """
    fit = _fit(judged)
    if fit is None or (not known and imposed(judged)):
        return ""
    said = []
    for term, values in zip(fit.model.terms, fit.model.values(fit.z), strict=True):
        scale = motor_inertia(judged.case.joint) if term.name == "inertia" else 1.0
        value, nominal = scale * values[0], scale * term.nominal[0]
        if term.name == "gravity":  # fitted as a cos q + b sin q
            value, nominal = math.hypot(*values), math.hypot(*term.nominal)
        if is_usual_offset(judged, term.name, value) or not term.told or _is_unlisted(judged, term):
            continue
        far = is_far_off(judged, term, values[0])
        if known and not far:
            if term.numbers[0].prior or _guessed(judged.case.joint, term):
                continue
            if _is_unseen(judged, term):
                continue
        within = term.name in LATE and _within_a_row(judged, term, value, nominal)
        much = abs(value - nominal) > REFINED * max(abs(value), abs(nominal))
        if not within and (much or far):
            said.append(_in_words(judged, term, value, nominal))
    return f"{NAMELESS} {', '.join(said)}." if said else ""


def _in_words(judged: Judgement, term: Term, value: float, nominal: float) -> str:
    """Return a refined value beside that of the datasheet, with its symbol and unit."""
    joint = judged.case.joint
    symbol = "torque" if term.name == "gravity" else term.numbers[0].symbol
    parameter = EFFECTS[term.name].parameter(symbol)
    if parameter is None:  # a number of the fit alone
        return f"{term.name} {plain(value)} for {plain(nominal)}"
    unit = unit_on(parameter, joint.parameters)
    if term.name == "inertia":  # of all bodies that move as one with the rotor
        parts = [f"I_{b}" for b in body_group(joint.structure_row, "m")]
        symbol = " + ".join(s for s in parts if joint.parameters.get(s, 0.0) > 0.0) or symbol
    size = plain(value) if unit == "-" else f"{plain(value)} {unit}"
    return f"{term.name} {symbol} {size} for {plain(nominal)}"


def _is_unlisted(judged: Judgement, term: Term) -> bool:
    """Return whether a term only completes the law of dry friction that the datasheet has."""
    return term.name == "presliding" and term.name not in judged.case.joint.file.effects


def is_far_off(judged: Judgement, term: Term, value: float) -> bool:
    """Return whether a value is far outside the tolerance that the datasheet states."""
    stated = stated_tolerance(judged.case.joint, term)
    ratio = value / term.nominal[0] if stated and term.nominal[0] else 1.0
    return ratio > 0.0 and abs(math.log(ratio)) > OUTSIDE * (stated or 0.0) > 0.0


def _is_unseen(judged: Judgement, term: Term) -> bool:
    """Return whether no error shows that a value left its datasheet, or that bristles bend."""
    if term.name == "presliding":  # one that bends visibly has a name
        return True
    if term.tight is None or judged.found is None or judged.answer != "found":
        return False
    keys = [t.key for t in judged.found.fit.model.terms]
    return not judged.found.worths[keys.index(term.key)].seen


def _within_a_row(judged: Judgement, term: Term, value: float, nominal: float) -> bool:
    """Return whether delays [s] or bandwidths [Hz] differ by less than half a row."""
    late = [value, nominal]
    if term.name == "current_lag":
        late = [1.0 / (2.0 * np.pi * x) if x > 0.0 else np.inf for x in late]
    return abs(late[0] - late[1]) < 0.5 * judged.case.logs[0].dt


def is_usual_offset(judged: Judgement, name: str, torque: float) -> bool:
    """Return whether a constant torque [N m] is no more than an amplifier's usual offset."""
    p, log = judged.case.joint.parameters, judged.case.logs[0]
    usual = USUAL_CURRENT if log.drive == "i" else USUAL_COMMAND * float(np.ptp(log.command))
    small = abs(torque) <= OUTSIDE * p.k_t * p.n * usual
    return name == "torque_offset" and not log.voltage and small


def _guessed(joint: Joint, term: Term) -> bool:
    """Return whether the datasheet guesses or hardly knows what the numbers of a term replace."""
    symbols = [f"d_{b}" for b in body_group(joint.structure_row, "m")]
    known = joint.parameters.quantities
    stated = [known[s] for s in symbols if s in known and known[s].number != 0.0]
    return (
        term.name == "damping"
        and bool(stated)
        and all(q.guess or (q.tolerance or 0.0) >= VAGUE for q in stated)
    )


def imposed(judged: Judgement) -> str:
    """Return a sentence on an unrealistic inertia where something else imposes the motion."""
    fit = _fit(judged)
    if fit is None or all(row.found < LOUD for row in judged.rows):
        return ""
    joint, (first, *_) = judged.case.joint, fit.model.values(fit.z)
    total = motor_inertia(joint)
    inertia = total * first[0]
    own = max(total, *(one.inertia for one in inverse(joint, judged.case.logs)), 0.0)
    if inertia < HEAVY * own:
        return ""
    unit = "kg" if joint.parameters.axis == "prismatic" else "kg m^2"
    return (
        f"The inertia given, {plain(inertia)} {unit}, is one that the torque hardly moves: where "
        "something else imposes the motion it predicts best, and is not the joint's own: put the "
        "datasheet's back to simulate the joint."
    )


def _fit(judged: Judgement) -> Fit | None:
    """Return the fit that is the answer; None if the answer is not a fit."""
    if judged.found is None or judged.answer not in ("found", "base"):
        return None
    return judged.found.fit if judged.answer == "found" else judged.found.base
