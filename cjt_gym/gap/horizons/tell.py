"""From a judgement to what a diagnosis says: effects, joint, verdict, gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.confusable import advice
from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    Diagnosis,
    GapSize,
    Horizon,
    Interval,
    NamedEffect,
    StageGap,
    Suggestion,
    Unexplained,
)
from cjt_gym.gap.horizons.by_torque import (
    EITHER,
    HELD,
    agrees,
    covered,
    inertia_by_torque,
    told_by_torque,
)
from cjt_gym.gap.horizons.fit import Fit, Problem
from cjt_gym.gap.horizons.inverse import Spent, seen_in_torque
from cjt_gym.gap.horizons.judge import LOUD, NEAR, Judgement, Row
from cjt_gym.gap.horizons.model import Term, motor_inertia
from cjt_gym.gap.horizons.pictured import pictured
from cjt_gym.gap.horizons.scatter import Scatter
from cjt_gym.gap.horizons.sheet import stated_tolerance
from cjt_gym.gap.horizons.spread import Spread, spread_of
from cjt_gym.gap.horizons.windows import HORIZONS, WHOLE, bootstrapped
from cjt_gym.gap.horizons.write import joint_of

Floats = NDArray[np.float64]
SURE, FIRM = 1.4, 2.0
"""By how much, as a multiple of what is needed, an effect is clear and worth to be confirmed."""
OUTSIDE = 3.0
"""Deviations of a datasheet value from which it is told apart from its tolerance."""
MIMICS = frozenset({"gravity", "thermal_derating", "viscous_asym", "load_friction"})
"""Effects that position, time or a wrong input may mimic: confirmed only where much depends on
them."""
LEVELS = frozenset({"coulomb", "coulomb_asym"})
"""Dry friction that is left at speed, without which falling friction would fall to nothing."""
LATE = frozenset({"command_delay", "current_lag"})
"""Effects that only a measured current tells from what is slow behind it."""
MUCH = 0.5
"""Share of the squared error that such an effect has to take away."""
NOTHING = 1e-3
"""Share of the step of a search by which an effect must differ from none at all."""
MOST_ADVICE = 2
"""Sentences of advice of each kind."""
SKEW = frozenset({"coulomb_asym", "viscous_asym", "torque_offset"})
"""Effects that differ between the directions, of which several together are one another's rest."""
HALVED = 0.5
"""Error, over that of the datasheet, from which there is a gap though nothing has a name."""
REFINED = 0.1
"""Relative difference from which a refined value is told."""
COMBINED = ("gravity", "viscous_asym")
"""Effects whose numbers in the effect table are combinations of those that are fitted."""
STAGES = {"q_m": "motor", "q_l": "load", "tau": "transmission"}


def horizons_of(judged: Judgement) -> tuple[Horizon, ...]:
    """Return the table of horizons as a diagnosis states it."""
    return tuple(
        Horizon(
            row.seconds if row.seconds != WHOLE else _length(judged),
            row.channel, row.datasheet, row.least_squares, row.found, row.floor,
        )
        for row in judged.rows
    )  # fmt: skip


def _length(judged: Judgement) -> float:
    groups = [g for g in judged.case.test.groups if g.horizons == (WHOLE,)]
    return float(max(g.length * judged.case.test.logs[g.log].dt for g in groups))


def retold(
    first: Diagnosis, judged: Judgement, excluded: Mapping[str, str], record: str
) -> Diagnosis:
    """Return a diagnosis whose answer is that of a judgement.

    Args:
        first: The diagnosis of the stages.
        judged: The judgement, whose answer is not that of the stages.
        excluded: Effects that the record cannot tell, with the reason.
        record: Name of the record, for the joint's sources.
    """
    seen = seen_in_torque(judged.case.joint, judged.case.logs, excluded)
    effects = _effects(judged, excluded, seen)
    regressed, loud = judged.answer == "least squares", main_row(judged).found > LOUD
    if judged.answer == "datasheet" and not loud:
        seen = {}
    if loud:  # nothing predicts the motion: the torque alone tells
        effects = tuple(e for e in effects if not covered(e.name, seen))
    if not (regressed or loud):
        seen = _beside(judged, seen)
    by_torque = told_by_torque(judged, seen, effects, alone=regressed or loud)
    held = by_torque and loud and not regressed
    effects = tuple(sorted((*effects, *by_torque), key=lambda e: -e.gap_removed))
    if judged.cut and first.verdict == "unexplained":  # the cause is none of the table's
        effects = tuple(as_tentative(e) for e in effects)
    rows = judged.rows
    stages = _stages(first, judged, effects)
    verdict = _verdict(judged, effects, suspected=bool(first.effects))
    unexplained = _unexplained(judged, verdict, judged.unexplained)
    if held:
        unexplained = replace(unexplained, text=f"{HELD} {unexplained.text}")
    elif not effects and (refined := _refined(judged)):
        unexplained = replace(unexplained, text=f"{refined} {unexplained.text}")
    if judged.cut and first.verdict == "unexplained":
        verdict, unexplained = "partly_explained" if effects else "unexplained", first.unexplained
    return replace(
        first,
        verdict=verdict,
        stages=stages,
        effects=effects,
        gap=_gap(judged),
        unexplained=unexplained,
        joint=joint_of(judged, effects, record),
        suggestion=_suggestion(judged, effects, first),
        evidence=pictured(judged, first.evidence),
        horizons=horizons_of(judged),
        regimes=first.regimes if rows else (),
    )


def _beside(judged: Judgement, seen: Mapping[str, Spent]) -> dict[str, Spent]:
    """Return what a torque shows and a fit that predicts does not contradict.

    A fit that has the effect has to find it as large; one that has not must leave something open.
    """
    if judged.found is None:
        return {}
    fit = judged.found.base if judged.answer == "base" else judged.found.fit
    open_ = main_row(judged).found > NEAR
    values = fit.model.values(fit.z)
    fitted = {t.name: v for t, v in zip(fit.model.terms, values, strict=True)}
    return {
        name: one
        for name, one in seen.items()
        if (agrees(one, fitted[name]) if name in fitted else open_)
    }


def _suggestion(judged: Judgement, effects: Sequence[NamedEffect], first: Diagnosis) -> Suggestion:
    """Return what to record next: what tells the named effects from their rivals."""
    pairs = [(e.name, rival) for e in effects for rival in e.confusable_with]
    told = dict.fromkeys(advice(name, rival) for name, rival in pairs)
    exam = first.examination
    faults = exam.advice if exam is not None else ()
    parts = [*list(told)[:MOST_ADVICE], *list(faults)[:MOST_ADVICE]]
    if not parts and judged.unexplained:
        parts = ["Record slow and fast motion in both directions over the whole travel."]
    return Suggestion(" ".join(parts) or "Nothing more is needed on this record's range.")


# ---- effects
def as_tentative(effect: NamedEffect) -> NamedEffect:
    """Return an effect that is not confirmed."""
    return replace(effect, status="tentative", confidence=min(effect.confidence, 0.5))


def _effects(
    judged: Judgement, excluded: Mapping[str, str], seen: Mapping[str, Spent]
) -> tuple[NamedEffect, ...]:
    """Return the effects that deserve a name, by the share of the error that they take away."""
    if judged.found is None or judged.problem is None or judged.answer == "datasheet":
        return _of_drive(judged)
    found, problem = judged.found, judged.problem
    spread = spread_of(problem, found.fit)
    named = []
    for k, term in enumerate(found.fit.model.terms):
        there = judged.answer == "found" or term.name in judged.joint.effects
        if there and term.name not in excluded and _deserves(judged, k, term, seen):
            effect = _named(judged, problem, spread, k, term)
            named.append(_regressed(judged, effect) if judged.answer == "least squares" else effect)
    named += [e for e in _of_drive(judged) if e.name not in {n.name for n in named}]
    return tuple(sorted(_folded(named), key=lambda e: -e.gap_removed))


def _regressed(judged: Judgement, effect: NamedEffect) -> NamedEffect:
    """Return an effect that a search has found, with the numbers of the regression given."""
    given = judged.joint.effects[effect.name]
    numbers = {
        symbol: replace(one, value=x, low=min(one.low, x), high=max(one.high, x))
        for symbol, one in effect.parameters.items()
        if isinstance(x := given.get(symbol, one.value), float)
    }
    return as_tentative(replace(effect, parameters=numbers))


def _folded(named: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Return effects with dry friction as a part of presliding, where that explains much."""
    whole = {e.body: e for e in named if e.name == "presliding" and e.gap_removed > MUCH}
    parts = {e.body: e for e in named if e.name == "coulomb" and e.body in whole}
    rest = [e for e in named if e not in parts.values()]
    return [
        replace(e, parameters={**parts[e.body].parameters, **e.parameters})
        if e.body in parts and e.name == "presliding"
        else e
        for e in rest
    ]


def _deserves(judged: Judgement, index: int, term: Term, seen: Mapping[str, Spent]) -> bool:
    """Return whether a term differs from the datasheet by more than that allows."""
    assert judged.found is not None
    found = judged.found
    values = found.fit.model.values(found.fit.z)[index]
    if not found.worths[index].enough and not agrees(seen.get(term.name), values):
        return False
    as_given = {t.key: t for t in found.base.model.terms}  # the last fit holds the inertia
    number = as_given.get(term.key, term).numbers[0]
    if number.prior:
        tolerance = stated_tolerance(judged.case.joint, term)
        if tolerance is None and number.scale >= 0.5:
            return False  # a guess is corrected, not diagnosed
        off = [np.log(x / term.nominal[0]) for x in (values[0], *inertia_by_torque(judged, term))]
        nearest = min(np.abs(off)) if min(off) * max(off) > 0.0 else 0.0
        return bool(nearest > OUTSIDE * (tolerance or number.scale))
    pairs = zip(values, term.nominal, term.numbers, strict=True)
    return any(abs(value - off) > NOTHING * n.scale for value, off, n in pairs)


def _intervals(judged: Judgement, spread: Spread, index: int) -> dict[str, Interval]:
    """Return the intervals of a term; that of the inertia covers what regressions find."""
    term, found = spread.model.terms[index], spread.intervals(index)
    if term.name in COMBINED:
        return Scatter.of(spread).of_effect(term.name)
    others = inertia_by_torque(judged, term)
    for symbol, one in found.items() if others else ():
        known = [x * one.value / spread.model.values(spread.fit.z)[index][0] for x in others]
        found[symbol] = replace(one, low=min(one.low, *known), high=max(one.high, *known))
    return found


def _named(
    judged: Judgement, problem: Problem, spread: Spread, index: int, term: Term
) -> NamedEffect:
    assert judged.found is not None
    found = judged.found
    worth, test = found.worths[index], judged.tests[index] if judged.tests else None
    rivals = found.rivals[index] if index < len(found.rivals) else ()
    genuine = tuple(r for r in rivals if r not in NESTED.get(term.name, ()))
    same = tuple(n for n in EITHER.get(term.name, ()) if n not in genuine)
    names = {t.name for t in found.fit.model.terms}
    if term.name == "coulomb" and "torque_offset" in names:
        same = ("coulomb_asym",)
    if term.name in SKEW and len(SKEW & names) > 1:
        same = tuple(sorted(SKEW - {term.name}))
    removed = _removed(found.less[index], found.fit)
    firm = worth.clear > SURE * worth.needed and worth.fall > FIRM * worth.price
    firm = firm and not genuine and not same
    firm = firm and (test is None or test.fall > 0.0)
    firm = firm and (term.name not in MIMICS or removed > MUCH)
    firm = firm and (term.name != "stribeck" or bool(names & LEVELS))
    firm = firm and (term.name not in LATE or judged.case.logs[0].drive == "i")
    firm = firm and not judged.unexplained and _worst(judged).found < LOUD
    confidence = float(np.clip(1.0 - 0.5 ** (worth.clear / worth.needed), 0.05, 0.99))
    return NamedEffect(
        term.name, term.stage, term.body, term.channel, _intervals(judged, spread, index),
        "confirmed" if firm else "tentative", confidence if firm else min(confidence, 0.5),
        removed, tuple(dict.fromkeys((*genuine, *same))), worth.fall,
    )  # fmt: skip


NESTED: Mapping[str, tuple[str, ...]] = {
    "coulomb": ("coulomb_asym", "stribeck", "presliding"),
    "damping": ("viscous_asym",),
    "torque_offset": ("gravity",),
}
"""Rivals of which a term is a special case."""


def _removed(less: Fit, more: Fit) -> float:
    """Return the share of the squared error that a term takes away, where it takes most."""
    one, two = less.relative() ** 2, more.relative() ** 2
    return float(np.clip(np.max((one - two) / np.maximum(one, 1e-12)), 0.0, 1.0))


def _of_drive(judged: Judgement) -> tuple[NamedEffect, ...]:
    """Return what the drive does between its command and the measured current."""
    drive = judged.case.drive
    if drive is None:
        return ()
    removed = 1.0 - (drive.after / max(drive.before, 1e-12)) ** 2
    found = []
    if drive.late:
        low, high = drive.delay - drive.step, drive.delay + drive.step
        delay = Interval(drive.delay, max(low, 0.0), high, "s")
        found.append(("command_delay", {"delay": delay}))
    if drive.lagging:
        bandwidth = 1.0 / (2.0 * np.pi * drive.lag)
        value = Interval(bandwidth, 0.7 * bandwidth, 1.4 * bandwidth, "Hz")
        found.append(("current_lag", {"bandwidth": value}))
    other = {"command_delay": ("current_lag",), "current_lag": ("command_delay",)}
    return tuple(
        NamedEffect(name, "drive", None, None, numbers, "tentative", 0.5, removed, other[name])
        for name, numbers in found
    )


# ---- stages, gap, verdict
def _stages(
    first: Diagnosis, judged: Judgement, effects: Sequence[NamedEffect]
) -> dict[str, StageGap]:
    """Return the stages in units of what no model could predict, where a channel shows them."""
    out = dict(first.stages)
    for channel, stage in STAGES.items():
        rows = [r for r in judged.rows if r.channel == channel and r.floor]
        if rows:
            worst = max(rows, key=lambda r: r.datasheet / max(r.floor or 1.0, 1e-9))
            floor = max(worst.floor or 1.0, 1e-9)
            named = any(e.stage == stage for e in effects) or any(r.unexplained for r in rows)
            out[stage] = StageGap(worst.datasheet / floor, worst.found / floor, named)
    return out


def main_row(judged: Judgement) -> Row:
    """Return the row whose error is the gap: the torque as a whole, or the longest horizon.

    A torque of which nothing could be predicted, being small beside its noise, measures no gap.
    """
    whole = judged.case.joint.structure_row.output_fixed
    torque = [r for r in judged.rows if r.channel == "tau"]
    heard = torque and (whole or torque[-1].floor is None or torque[-1].floor < LOUD)
    channel = "tau" if heard else "q_m"
    rows = [r for r in judged.rows if r.channel == channel]
    return next((r for r in rows if whole and r.seconds == WHOLE), rows[-1])


def _gap(judged: Judgement) -> GapSize:
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


def _worst(judged: Judgement) -> Row:
    """Return the row of the main channel with the largest error, the shortest horizon left out."""
    main = main_row(judged)
    if main.seconds == WHOLE:
        return main
    rows = [r for r in judged.rows if r.channel == main.channel and r.seconds > min(HORIZONS)]
    return max(rows, key=lambda r: r.found, default=main)


def _verdict(judged: Judgement, effects: Sequence[NamedEffect], *, suspected: bool) -> str:
    loud = _worst(judged).found > LOUD
    open_ = bool(judged.unexplained) or loud
    if not effects:
        better = any(r.found < 0.85 * r.datasheet for r in judged.rows)
        main = main_row(judged)
        moved = main.found < HALVED * main.datasheet and _refined(judged, known=True)
        return "unexplained" if moved or (open_ and (better or suspected or loud)) else "no_gap"
    return "partly_explained" if open_ else "explained"


def _unexplained(judged: Judgement, verdict: str, left: Sequence[Row]) -> Unexplained:
    row = max(left, key=lambda r: r.found**2 * (r.left.share if r.left else 0.0), default=None)
    said = _said(judged)
    if row is None or row.left is None:
        main = _worst(judged)
        if verdict in ("explained", "no_gap"):
            return Unexplained(0.0, None, " ".join([said, NOTHING_LEFT]).strip(), 0.0)
        share = min(main.found, 1.0) ** 2
        text = (
            f"Of what {main.channel} does within {_ahead(main)}, {main.found:.0%} is not "
            "predicted, and no regression predicts it either."
        )
        return Unexplained(share, STAGES[main.channel], f"{said} {text}".strip(), 0.0)
    predictable = min(row.found, 1.0) ** 2 * row.left.share
    share = row.left.share
    text = (
        f"{share:.0%} of the error of {row.channel} {_ahead(row)} ahead could be predicted from "
        "speed, angle, input and the past, but no effect of the table explains it."
    )
    return Unexplained(share, STAGES[row.channel], f"{said} {text}".strip(), predictable)


def _refined(judged: Judgement, *, known: bool = False) -> str:
    """Return which values of the joint given differ from the datasheet's, though none is named.

    Args:
        judged: The judgement.
        known: Whether guesses of the datasheet, and what it allows, do not count.
    """
    if judged.found is None or judged.answer not in ("found", "base"):
        return ""
    fit = judged.found.fit if judged.answer == "found" else judged.found.base
    said = []
    for term, values in zip(fit.model.terms, fit.model.values(fit.z), strict=True):
        scale = motor_inertia(judged.case.joint) if term.name == "inertia" else 1.0
        value, nominal = scale * values[0], scale * term.nominal[0]
        if known and term.numbers[0].prior:
            continue
        if abs(value - nominal) > REFINED * max(abs(value), abs(nominal)):
            said.append(f"{term.name} {value:.3g} for {nominal:.3g}")
    return f"No cause is named; refined values predict better: {', '.join(said)}." if said else ""


def _ahead(row: Row) -> str:
    return "the whole record" if row.seconds == WHOLE else f"{row.seconds:g} s"


def _said(judged: Judgement) -> str:
    """Return which joint is the answer, where it is not one with named effects."""
    return {
        "least squares": "Nothing predicts better than least squares on inertia, damping, Coulomb "
        "friction and offset: that is the joint given.",
        "datasheet": "Nothing was found that predicts better than the datasheet.",
    }.get(judged.answer, "")
