"""Gap, stages, verdict and unexplained part of a judgement."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.candidates.nuisances import USUAL_COMMAND, USUAL_CURRENT
from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    Diagnosis,
    GapSize,
    NamedEffect,
    StageGap,
    Unexplained,
)
from cjt_gym.gap.horizons.fit import Fit
from cjt_gym.gap.horizons.inverse import inverse
from cjt_gym.gap.horizons.judgement import LOUD, NEAR, Judgement, Row
from cjt_gym.gap.horizons.model import Term, body_group, motor_inertia
from cjt_gym.gap.horizons.sheet import stated_tolerance
from cjt_gym.gap.horizons.windows import HORIZONS, TRIVIAL, WHOLE, bootstrapped
from cjt_gym.gap.recorded.tolerances import OUTSIDE, VAGUE
from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.effect_entries import unit_on

DRIFTLESS = 0.1
"""Relative error over a whole record of a held output, which does not drift, above which nothing
counts as explained: on simulated logs with noise that was stated wrong, no right explanation left
more."""
HALVED = 0.5
"""Ratio to the datasheet's error below which there is a gap even if no effect is named."""
HEAVY = 10.0
"""Multiple of the inertia of datasheet and regressions at or above which it is not realistic."""
REFINED = 0.1
"""Relative difference above which a refined value is reported."""
NAMELESS = "No cause is named; refined values predict better:"
BESIDE = "Refined values predict better:"
"""What introduces values that differ from the datasheet without and beside a cause."""
SLOPED = (
    "No joint beats motion at the measured speed: predictions start from the slope of the angle."
)
"""What is said where even the best joint is worse than that."""
LATE = frozenset({"command_delay", "current_lag"})
"""Effects that cannot be separated from slow mechanics without a measured current."""
LEAST = "least squares"
REGRESSED = (
    ("inertia", "inertia", "I_m"),
    ("damping", "damping", "d_m"),
    ("Coulomb friction", "coulomb", "d_cm"),
    ("offset", "torque_offset", "torque"),
)
"""Name of the answer that is a regression, and its values: words, effect and symbol."""
PERHAPS = 0.5
"""Share of a squared error that seems predictable, though not surely, above which it is unknown."""
QUIET = 0.05
"""Relative error up to which nothing need be said of what is left."""
STAGES = {"q_m": "motor", "q_l": "load", "tau": "transmission"}


def stages_of(
    first: Diagnosis, judged: Judgement, effects: Sequence[NamedEffect]
) -> dict[str, StageGap]:
    """Return the stages' gaps in units of the unpredictable error, if a channel shows them.

    What acts on bodies whose channels were not recorded shows in the motor's.
    """
    out = dict(first.stages)
    shown = {STAGES[row.channel] for row in judged.rows}
    blamed = {
        e.stage if e.stage in shown else "motor" for e in effects if e.stage in STAGES.values()
    }
    for channel, stage in STAGES.items():
        rows = [r for r in judged.rows if r.channel == channel and r.floor]
        if rows:
            worst = max(rows, key=lambda r: r.datasheet / max(r.floor or 1.0, 1e-9))
            floor = max(worst.floor or 1.0, 1e-9)
            named = stage in blamed or any(r.unexplained for r in rows)
            out[stage] = StageGap(worst.datasheet / floor, worst.found / floor, named)
    return out


def main_row(judged: Judgement) -> Row:
    """Return the row that measures the gap: the torque as a whole, or the longest horizon.

    A torque that is unpredictable, being small compared with its noise, does not measure the gap.
    """
    whole = judged.case.joint.structure_row.output_fixed
    torque = [r for r in judged.rows if r.channel == "tau"]
    heard = torque and (whole or torque[-1].floor is None or torque[-1].floor < LOUD)
    channel = "tau" if heard else "q_m"
    rows = [r for r in judged.rows if r.channel == channel]
    return next((r for r in rows if whole and r.seconds == WHOLE), rows[-1])


def gap_of(judged: Judgement) -> GapSize:
    """Return the gap on held-out data, from the row that measures it."""
    row = main_row(judged)
    before, after = row.datasheet, row.found
    removed = 1.0 - after / before if before > 0.0 else 0.0
    key = (row.channel, row.seconds)
    low, high = bootstrapped(
        judged.case.test, judged.errors["datasheet"], judged.errors[judged.answer], key
    )
    by = {
        r.channel: {"before": r.datasheet, "after": r.found}
        for r in judged.rows
        if r.seconds == row.seconds
    }
    floor = row.floor if row.floor is not None else 0.0
    return GapSize(before, after, floor, removed, low, high, True, by)


def worst_row(judged: Judgement) -> Row:
    """Return the main channel's row with the largest error, except the shortest horizon."""
    main = main_row(judged)
    if main.seconds == WHOLE:
        return main
    rows = [r for r in judged.rows if r.channel == main.channel and r.seconds > min(HORIZONS)]
    return max(rows, key=lambda r: r.found, default=main)


def verdict_of(judged: Judgement, effects: Sequence[NamedEffect], *, suspected: bool) -> str:
    """Return the verdict.

    Args:
        judged: The judgement.
        effects: Named effects.
        suspected: Whether the stages have named any effects.
    """
    worst = worst_row(judged)
    loud = worst.found > (LOUD if worst.seconds != WHOLE else DRIFTLESS)
    unknown = unknown_row(judged) is not None
    open_ = bool(judged.unexplained) or loud or unknown
    if not effects:
        better = any(r.found < 0.85 * r.datasheet for r in judged.rows)
        main = main_row(judged)
        other = judged.answer == LEAST or bool(refined(judged, known=True))
        moved = main.found < HALVED * main.datasheet > HALVED * TRIVIAL and other
        lasting = any(r.seconds > min(HORIZONS) and r.lasting for r in judged.unexplained)
        open_ = loud or unknown or (open_ and (better or suspected or lasting))
        return "unexplained" if moved or open_ else "no_gap"
    return "partly_explained" if open_ else "explained"


def unknown_row(judged: Judgement) -> Row | None:
    """Return a row whose error is not small and may be predictable for all that a record shows.

    A short record has too few windows to tell; one of few motions may have too few to be sure.
    """
    worst = worst_row(judged)
    main = [r for r in judged.rows if r.channel == worst.channel and r.seconds > min(HORIZONS)]
    perhaps = [r for r in main if r.left is not None and r.left.share > PERHAPS]
    doubtful = [worst] if worst.left is None and worst.seconds != WHOLE else []
    doubtful += [r for r in perhaps if not r.unexplained]
    return next((r for r in doubtful if r.found > NEAR), None)


def unexplained_of(judged: Judgement, verdict: str, left: Sequence[Row]) -> Unexplained:
    """Return the unexplained part and its description, from rows with a predictable error."""
    rows = left if verdict != "no_gap" else ()
    row = max(rows, key=lambda r: r.found**2 * (r.left.share if r.left else 0.0), default=None)
    said = _said(judged)
    if row is None or row.left is None:
        unknown = unknown_row(judged)
        main = unknown or worst_row(judged)
        if verdict in ("explained", "no_gap"):
            known = main.left is not None or main.found < QUIET or main.seconds == WHOLE
            text = NOTHING_LEFT if known else _not_told(main)
            return Unexplained(0.0, None, f"{said} {text}".strip(), 0.0)
        share = min(main.found, 1.0) ** 2
        if unknown is not None:
            text = _not_told(unknown)
        elif main.found < QUIET:
            text = ""  # the refined values leave next to nothing
        else:
            slack = "although a held output does not drift"
            rest = slack if main.seconds == WHOLE else "and no regression predicts it either"
            text = f"{_not_predicted(main)}, {rest}."
        return Unexplained(share, STAGES[main.channel], f"{said} {text}".strip(), 0.0)
    predictable = min(row.found, 1.0) ** 2 * row.left.share
    share = row.left.share
    source = "speed, angle, input and the past, but no effect of the table explains it."
    if row.lasting:
        source = (
            "the errors just before: something lasting acts that neither state nor input shows, "
            "such as an external torque."
        )
    text = (
        f"{share:.0%} of the squared error of {row.channel} {_ahead(row)} ahead could be predicted "
        f"from {source}"
    )
    return Unexplained(share, STAGES[row.channel], f"{said} {text}".strip(), predictable)


def _not_predicted(row: Row) -> str:
    """Return the beginning of a sentence on the error of a row."""
    left = f"{100.0 * row.found:.{2 if row.found < 0.995 else 3}g} % is not predicted"
    return f"Of what {row.channel} does within {_ahead(row)}, {left}"


def _not_told(row: Row) -> str:
    return f"{_not_predicted(row)}; this record does not tell how much of it could be."


def corrected(judged: Judgement) -> str:
    """Return sentences on the guesses of the datasheet that the answer corrects."""
    said = []
    guesses = {s: q for s, q in judged.case.joint.parameters.quantities.items() if q.guess}
    for symbol, quantity in guesses.items():
        new = _given(judged, symbol)
        if abs(new - quantity.number) > REFINED * max(new, quantity.number):
            said.append(
                f"The guess of {symbol}, {quantity.number:.3g} {quantity.unit}, is corrected to "
                f"{new:.3g}."
            )
    return " ".join(said)


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
        f"What moves as one has an inertia of {new:.3g} {unit} instead of {old:.3g}; the record "
        f"does not tell how {' and '.join(parts)} share it."
    )


def gave_way(judged: Judgement, effects: Sequence[NamedEffect]) -> str:
    """Return a sentence on the stated values that no effect names and that left their tolerance.

    Bodies that move as one count together.
    """
    nominal = judged.case.joint
    named = {symbol for e in effects for symbol in e.parameters}
    moving = tuple(f"I_{b}" for b in body_group(nominal.structure_row, "m"))
    known = nominal.parameters.quantities
    said = []
    alone = [(s,) for s in ("k_t", "k_b", "k_g", "I_l") if s not in moving]
    for symbols in (moving, *alone):
        parts = {s: known[s] for s in symbols if s in known and known[s].number > 0.0}
        if not parts or named & {*symbols} or any(not q.tolerance for q in parts.values()):
            continue
        old, new = sum(q.number for q in parts.values()), sum(_given(judged, s) for s in parts)
        spread = math.hypot(*(q.number * (q.tolerance or 0.0) for q in parts.values())) / old
        if abs(math.log(max(new, 1e-12 * old) / old)) > OUTSIDE * spread:
            unit = next(iter(parts.values())).unit
            within = f"for {old:.3g} within {100.0 * spread:.2g} %"
            said.append(f"{' + '.join(parts)} = {new:.3g} {unit} {within}")
    if not said:
        return ""
    return (
        f"What fits best leaves the datasheet's tolerance: {', '.join(said)}. If another value of "
        "the datasheet is off instead, the sizes named here change with it."
    )


def _given(judged: Judgement, symbol: str) -> float:
    """Return a value of the joint that is the answer, from its effects or its parameters."""
    nominal, answer = judged.case.joint, judged.joint
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
    if fit is None or (not known and _imposed(judged)):
        return ""
    said = []
    for term, values in zip(fit.model.terms, fit.model.values(fit.z), strict=True):
        scale = motor_inertia(judged.case.joint) if term.name == "inertia" else 1.0
        value, nominal = scale * values[0], scale * term.nominal[0]
        if term.name == "gravity":  # fitted as a cos q + b sin q
            value, nominal = math.hypot(*values), math.hypot(*term.nominal)
        if is_usual_offset(judged, term.name, value) or not term.told or _is_unlisted(judged, term):
            continue
        far = _is_far_off(judged, term, values[0])
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
        return f"{term.name} {value:.3g} for {nominal:.3g}"
    unit = unit_on(parameter, joint.parameters)
    if term.name == "inertia":  # of all bodies that move as one with the rotor
        parts = [f"I_{b}" for b in body_group(joint.structure_row, "m")]
        symbol = " + ".join(s for s in parts if joint.parameters.get(s, 0.0) > 0.0) or symbol
    return f"{term.name} {symbol} {value:.3g} {unit} for {nominal:.3g}".replace(" - for", " for")


def _is_unlisted(judged: Judgement, term: Term) -> bool:
    """Return whether a term only completes the law of dry friction that the datasheet has."""
    return term.name == "presliding" and term.name not in judged.case.joint.file.effects


def _is_far_off(judged: Judgement, term: Term, value: float) -> bool:
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


def _ahead(row: Row) -> str:
    return "the whole record" if row.seconds == WHOLE else f"{row.seconds:g} s"


def _said(judged: Judgement) -> str:
    """Return sentences on where predictions start, and on an answer without named effects."""
    sloped = any(log.from_slope for log in judged.case.logs)
    return f"{SLOPED if sloped else ''} {_of_answer(judged)}".strip()


def _of_answer(judged: Judgement) -> str:
    """Return a sentence on the answer if it is not a joint with named effects."""
    if judged.answer == LEAST:
        *most, last = (_regressed(judged.joint, *one) for one in REGRESSED)
        told = f"{', '.join(most)} and {last}"
        return f"Nothing predicts better than least squares on {told}: that is the joint given."
    if judged.answer == "datasheet":
        return "Nothing was found that predicts better than the datasheet."
    return _imposed(judged)


def _regressed(joint: Joint, words: str, effect: str, symbol: str) -> str:
    """Return a value of the least-squares joint in words."""
    parameter = EFFECTS[effect].parameter(symbol)
    assert parameter is not None
    unit = unit_on(parameter, joint.parameters)
    return f"{words} ({joint.effects[effect][symbol]:.3g} {unit})"


def _imposed(judged: Judgement) -> str:
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
        f"The inertia given, {inertia:.3g} {unit}, is one that the torque hardly moves: where "
        "something else imposes the motion it predicts best, and is not the joint's own."
    )


def _fit(judged: Judgement) -> Fit | None:
    """Return the fit that is the answer; None if the answer is not a fit."""
    if judged.found is None or judged.answer not in ("found", "base"):
        return None
    return judged.found.fit if judged.answer == "found" else judged.found.base
