"""Which terms of a search are named, with which status, numbers and rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.diagnosis import EVEN_CHANCE, LEVELLESS, MUCH_LEFT, Interval, NamedEffect
from cjt_gym.gap.horizons.findings.by_torque import DRY, agrees, either, inertia_by_torque
from cjt_gym.gap.horizons.findings.corrected_values import LATE, imposed
from cjt_gym.gap.horizons.findings.held_output import held_alike
from cjt_gym.gap.horizons.findings.naming_rules import (
    LEVELS,
    MUCH,
    SURE,
    follows_at_once,
    is_named,
    is_open,
    is_overwhelming,
    may_be_as_stated,
    share_removed,
    shares,
)
from cjt_gym.gap.horizons.findings.not_confirmed import STRAIGHT
from cjt_gym.gap.horizons.findings.verdict import HALVED, main_row, unknown_row, worst_row
from cjt_gym.gap.horizons.fitting.covariance import Scatter
from cjt_gym.gap.horizons.fitting.datasheet import stated_tolerance
from cjt_gym.gap.horizons.fitting.fit import Fit
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import Spread
from cjt_gym.gap.horizons.prediction.log import goes_both_ways
from cjt_gym.gap.horizons.prediction.model import SKEW, Term
from cjt_gym.gap.horizons.selection.judgement import LOUD, Judgement
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.horizons.torque.inverse import feels_weight, leans
from cjt_gym.gap.recorded.tolerances import VAGUE, tolerance_of

FIRM = 2.0
"""Multiple of its price above which an effect may be confirmed."""
STRAINED = 2.5
"""Number of stated tolerances up to which the other datasheet values may be off where an effect is
confirmed: beyond that, something else is missing that they make up for."""
SLIGHT = 0.02
"""Relative change of a datasheet value that strains none, however narrow its tolerance is."""
MIMICS = frozenset({"gravity", "viscous_asym", "load_friction"})
"""Effects that position or a wrong input may mimic: confirmed only if they remove more than
`MUCH` of the error."""
PLAIN, REFINEMENTS = frozenset({"coulomb", "load_coulomb"}), frozenset({"presliding", "stribeck"})
"""Plain dry friction, and laws that are told together with it."""
MIRRORED, ONE_SIDED = 1.5, 0.1
"""Ratio of the friction in the two directions up to which both are nearly the same, and ratio of
the smaller to the larger below which an offset beside equal friction is likelier: on three real
joints the mean of the two was then the dry friction that a regression saw."""
LEAST_LEVEL = 0.2
"""Least friction that remains at speed, relative to the additional friction at rest."""
SCALES = frozenset({"inertia", "torque_constant"})
"""Datasheet values that make up for heat of which the record does not tell when it began."""
COMBINED = ("gravity", "viscous_asym")
"""Effects whose numbers in the effect table are combinations of the fitted ones."""
NESTED: Mapping[str, tuple[str, ...]] = {
    "coulomb": ("coulomb_asym", "stribeck", "presliding"),
    "damping": ("viscous_asym",),
    "torque_offset": ("gravity",),
}
"""Rivals of which a term is a special case."""


def effects_of(
    judged: Judgement, excluded: Mapping[str, str], seen: Mapping[str, Spent]
) -> tuple[NamedEffect, ...]:
    """Return the effects to name, sorted by the share of the error that they remove."""
    if judged.found is None or judged.problem is None or judged.answer == "datasheet":
        return of_drive(judged)
    named = _of_search(judged, excluded, seen)
    main = main_row(judged)
    if not named and main.found < HALVED * main.datasheet:
        named = _of_search(judged, excluded, seen, alone=True)
    named += [e for e in of_drive(judged) if e.name not in {n.name for n in named}]
    named = [as_plain(effect) for effect in _folded(named) if effect.parameters]
    return tuple(sorted(named, key=lambda e: -e.gap_removed))


def _of_search(
    judged: Judgement,
    excluded: Mapping[str, str],
    seen: Mapping[str, Spent],
    *,
    alone: bool = False,
) -> list[NamedEffect]:
    """Return the terms of a search to name; `alone` as for `is_named`."""
    assert judged.found is not None
    assert judged.problem is not None
    found, spread, astray = judged.found, judged.spread, bool(imposed(judged))
    named = []
    for k, term in enumerate(found.fit.model.terms):
        there = judged.answer == "found" or term.name in judged.joint.effects
        open_ = term.name in excluded and not is_overwhelming(judged, k, excluded)
        at_once = term.name in LATE and follows_at_once(judged)
        unreal = term.name == "inertia" and astray
        if at_once or open_ or unreal or not (there and term.told):
            continue
        beside = shares(judged, k)
        if is_named(judged, k, term, seen, alone=alone, shared=bool(beside)):
            effect = _named(judged, spread, k, term)
            if beside:
                effect = effect.or_else([beside]).doubted(_instead([beside]))
            if _is_dry(judged, k, seen):
                effect = effect.or_else(["coulomb"]).doubted(_instead(["coulomb"]))
            carried = judged.misfit if term.numbers[0].prior else 1.0  # or it is wider already
            as_stated = may_be_as_stated(spread, term, effect, carried)
            if as_stated or is_open(judged, effect):
                continue
            named.append(_regressed(judged, effect) if judged.answer == "least squares" else effect)
    return named


def _is_dry(judged: Judgement, index: int, seen: Mapping[str, Spent]) -> bool:
    """Return whether a damping stands for dry friction that the torque shows and the fit lacks.

    Predictions of a motion of one frequency and size hardly tell one from the other.
    """
    assert judged.found is not None
    fit = judged.found.fit
    given = {t.name for t in fit.model.terms} | judged.joint.effects.keys()
    if fit.model.terms[index].name != "damping" or DRY & given or not DRY & seen.keys():
        return False
    return not agrees(seen.get("damping"), fit.model.values(fit.z)[index])


def _regressed(judged: Judgement, effect: NamedEffect) -> NamedEffect:
    """Return an effect found by a search, with the values of the regression that is the answer."""
    given = judged.joint.effects[effect.name]
    numbers = {
        symbol: replace(one, value=x, low=min(one.low, x), high=max(one.high, x))
        for symbol, one in effect.parameters.items()
        if isinstance(x := given.get(symbol, one.value), float)
    }
    regressed = replace(effect, parameters=numbers)
    return regressed.doubted("the answer is a regression, which does not choose among effects")


def _folded(named: Sequence[NamedEffect]) -> list[NamedEffect]:
    """Return effects with dry friction merged into a refinement of it that explains much."""
    whole = {e.body: e for e in named if e.name in REFINEMENTS and e.gap_removed > MUCH}
    parts = {e.body: e for e in named if e.name in PLAIN and e.body in whole}
    rest = [e for e in named if e not in parts.values()]
    return [
        replace(e, parameters={**parts[e.body].parameters, **e.parameters})
        if e.body in parts and e is whole[e.body]
        else e
        for e in rest
    ]


def as_plain(effect: NamedEffect) -> NamedEffect:
    """Return dry friction that differs with direction or speed as plain if that fits as well.

    It is nearly symmetric then, or acts in one direction only, as if an offset were hidden in it;
    or what it has more at low speed may be nothing, and is less than its level.
    """
    if _hardly_falls(effect):
        level = {k: x for k, x in effect.parameters.items() if k.startswith("d_c")}
        alike = (effect.name, *(n for n in effect.confusable_with if n != "coulomb"))
        return replace(effect, name="coulomb", parameters=level, confusable_with=alike)
    plain = "coulomb" in effect.confusable_with
    if effect.name != "coulomb_asym" or not plain or len(effect.parameters) != 2:
        return effect
    symbol, (one, two) = next(iter(effect.parameters)), effect.parameters.values()
    small, large = sorted((abs(one.value), abs(two.value)))
    low, high = min(one.low, two.low), max(one.high, two.high)
    if large > MIRRORED * small:
        if small > ONE_SIDED * large or "torque_offset" not in effect.confusable_with:
            return effect
        low, high = 0.5 * (one.low + two.low), 0.5 * (one.high + two.high)
    both = replace(one, value=0.5 * (one.value + two.value), low=low, high=high)
    alike = (effect.name, *(n for n in effect.confusable_with if n != "coulomb"))
    told = _instead(effect.confusable_with)
    doubt = effect.doubt.replace(told, _instead(alike))
    numbers = {symbol: both}
    return replace(effect, name="coulomb", parameters=numbers, confusable_with=alike, doubt=doubt)


def _hardly_falls(effect: NamedEffect) -> bool:
    """Return whether Stribeck friction may have no more than its level at low speed."""
    levels = [x for symbol, x in effect.parameters.items() if symbol.startswith("d_c")]
    rises = [x for symbol, x in effect.parameters.items() if symbol.startswith("d_s")]
    pairs = zip(rises, levels, strict=False)
    hardly = all(rise.low <= 0.0 and rise.high < level.low for rise, level in pairs)
    return effect.name == "stribeck" and bool(levels) and len(levels) == len(rises) and hardly


def _instead(alike: Sequence[str]) -> str:
    """Return the doubt about an effect that others may replace."""
    return f"{' or '.join(alike)} may take its place"


def _intervals(judged: Judgement, spread: Spread, index: int) -> dict[str, Interval]:
    """Return the intervals of a term; that of the inertia covers the results of regressions."""
    term, found = spread.model.terms[index], spread.intervals(index)
    if term.name in COMBINED:
        return Scatter.of(spread).of_effect(term.name)
    others = inertia_by_torque(judged, term)
    for symbol, one in found.items() if others else ():
        known = [spread.stated(term, x) for x in others]
        found[symbol] = replace(one, low=min(one.low, *known), high=max(one.high, *known))
    return found


def _named(judged: Judgement, spread: Spread, index: int, term: Term) -> NamedEffect:
    """Return a term as an effect: confirmed unless something is in doubt."""
    assert judged.found is not None
    assert judged.problem is not None
    fit, worth = judged.found.fit, judged.found.worths[index]
    felt = term.restated and not worth.seen  # by the torque: others make up for it
    less = judged.found.less[index]
    if felt:
        z = fit.z.copy()
        z[fit.model.span(index)] = [
            n.coordinate(x) for n, x in zip(term.numbers, term.nominal, strict=True)
        ]
        less = judged.problem.at(fit.model, z)
    removed, alike = share_removed(less, fit), _alike(judged, index, term)
    doubt = _doubt(judged, index, term, alike, removed)
    clear = worth.needed if felt else worth.clear
    confidence = float(np.clip(1.0 - 0.5 ** (clear / worth.needed), 0.05, 0.99))
    effect = NamedEffect(
        term.name, term.stage, term.body, term.channel, _intervals(judged, spread, index),
        "confirmed", confidence, removed, alike, worth.fall,
    )  # fmt: skip
    return effect.doubted(doubt) if doubt else effect


def _alike(judged: Judgement, index: int, term: Term) -> tuple[str, ...]:
    """Return the effects that may take the place of one, the likeliest first."""
    assert judged.found is not None
    found, log = judged.found, judged.case.logs[0]
    rivals = found.rivals[index] if index < len(found.rivals) else ()
    genuine = tuple(r for r in rivals if r not in NESTED.get(term.name, ()))
    same = tuple(n for n in either(term.name, judged.case.joint) if n not in genuine)
    names = {t.name for t in found.fit.model.terms}
    if term.name == "coulomb" and "torque_offset" in names:
        same = ("coulomb_asym",)
    if term.name in SKEW and len(SKEW & names) > 1:
        same = tuple(sorted(SKEW - {term.name}))
    same = (*same, *held_alike(term.name, judged.joint, log))
    if term.name == "gravity" and _may_push(judged):
        same = (*same, "contact")
    if term.name == "gravity" and term.restated:
        same = (*same, "torque_constant")
    if term.name in LATE and log.drive != "i":
        same = (*same, *(LATE - {term.name}))
    return tuple(dict.fromkeys((*genuine, *same)))


def _may_push(judged: Judgement) -> bool:
    """Return whether what looks like a weight may be a spring beside the joint or the ground."""
    joint, logs = judged.case.joint, judged.case.logs
    single = joint.structure_row.size == 1
    return scales_of(joint, logs).travel < STRAIGHT or (single and leans(joint, logs))


def _doubt(judged: Judgement, index: int, term: Term, alike: Sequence[str], removed: float) -> str:
    """Return why an effect is not confirmed; "" if it is."""
    assert judged.found is not None
    found, log, worst = judged.found, judged.case.logs[0], worst_row(judged)
    worth, test = found.worths[index], judged.tests[index] if judged.tests else None
    names = {t.name for t in found.fit.model.terms}
    strained = _strained(judged, term)
    theirs = "its tolerance" if len(strained) == 1 else "their tolerances"
    doubts = (
        (bool(alike), _instead(alike)),
        (
            term.restated and not worth.seen,
            "other values of the datasheet, off in proportion, may take its place",
        ),
        (
            worth.clear <= SURE * worth.needed or worth.fall <= FIRM * worth.price,
            "the record shows it in few places, or only just",
        ),
        (not judged.case.held, "nothing was held out to test it on: give a second record"),
        (test is not None and test.fall <= 0.0, "held-out data do not call for it"),
        (
            term.name in MIMICS and removed <= MUCH,
            "an error of the input or the angle may look like it",
        ),
        (_is_unfelt(judged, term), "the torque does not show it"),
        (_is_in_zero(judged, term), "the zero of the twist may take its place"),
        (_is_at_an_end(found.fit, index), "its number is at the end of its range"),
        (term.name == "stribeck" and not _levelled(found.fit, index), LEVELLESS),
        (
            log.voltage and term.name not in LATE and bool(LATE & names),
            "what delays its voltage stays open",
        ),
        (
            log.voltage and term.name == "torque_constant",
            "damping and inertia, off together, may take its place",
        ),
        (
            term.name == "damping" and _is_back_emf(judged, index),
            "the tolerances of k_t and r allow as much damping by the back EMF",
        ),
        (
            term.name in SCALES and "thermal_derating" in names,
            "how warm the motor was when the log began stays open",
        ),
        (
            term.name in LATE and log.drive != "i",
            "without the measured current, slow mechanics look the same",
        ),
        (bool(judged.unexplained) or worst.found >= LOUD, MUCH_LEFT),
        (
            unknown_row(judged) is not None,
            "this record does not tell how much stays unexplained",
        ),
        (bool(strained), f"{' and '.join(strained)} had to leave {theirs} beside it"),
    )
    return next((why for holds, why in doubts if holds), "")


def _is_in_zero(judged: Judgement, term: Term) -> bool:
    """Return whether a twist that is not zero without torque looks like friction of the load.

    Where the torque was not measured and all motion has one direction, both twist the spring alike.
    """
    logs = judged.case.logs
    if term.name != "load_coulomb" or any("tau" in log.measured for log in logs):
        return False
    return not any(goes_both_ways(log.states[log.inside, 5]) for log in logs)


def _is_at_an_end(fit: Fit, index: int) -> bool:
    """Return whether a number of a term would go on beyond its bound, other than to nothing."""
    model = fit.model
    pairs = zip(model.terms[index].numbers, fit.z[model.span(index)], strict=True)
    return any(n.at_bound(float(z)) and n.value(float(z)) != 0.0 for n, z in pairs)


def _is_unfelt(judged: Judgement, term: Term) -> bool:
    """Return whether the torque of a single mass does not show its weight.

    Where the input is noisy, a pull to the middle of the motion makes predictions drift less. A
    joint that coasts has no input.
    """
    joint, logs = judged.case.joint, judged.case.logs
    weighs = term.name == "gravity" and joint.structure_row.size == 1
    return weighs and not scales_of(joint, logs).coasts and not feels_weight(joint, logs)


def _is_back_emf(judged: Judgement, index: int) -> bool:
    """Return whether damping is no more than the tolerances of a voltage drive allow."""
    assert judged.found is not None
    joint, fit = judged.case.joint, judged.found.fit
    if not judged.case.logs[0].voltage or "r" not in joint.parameters:
        return False
    p, term = joint.parameters, fit.model.terms[index]
    off = math.hypot(*(k * tolerance_of(joint.file, s, VAGUE) for k, s in ((2, "k_t"), (1, "r"))))
    value = fit.model.values(fit.z)[index][0]
    return bool(abs(value - term.nominal[0]) < STRAINED * off * (p.k_t * p.n) ** 2 / p.r)


def _strained(judged: Judgement, term: Term) -> list[str]:
    """Return the other datasheet values that had to leave their stated tolerances."""
    assert judged.found is not None
    given = {t.key for t in judged.found.base.model.terms}
    fit, names = judged.found.fit, []
    for other, values in zip(fit.model.terms, fit.model.values(fit.z), strict=True):
        stated = stated_tolerance(judged.case.joint, other) if other.key in given else None
        if stated and other.key != term.key:
            off = abs(float(np.log(values[0] / other.nominal[0])))
            if off > max(STRAINED * stated, SLIGHT):
                names.append(other.numbers[0].symbol)
    return names


def _levelled(fit: Fit, index: int) -> bool:
    """Return whether dry friction falls to a level at speed rather than to zero."""
    joint, falling = fit.model.joint, fit.model.terms[index]
    levels = [
        abs(value)
        for term, values in zip(fit.model.terms, fit.model.values(fit.z), strict=True)
        for value in (values if term.name in LEVELS and term.body == falling.body else ())
    ]
    own = fit.model.values(fit.z)[index][0]
    return not LEVELS.isdisjoint(joint.effects) or max(levels, default=0.0) > LEAST_LEVEL * own


def of_drive(judged: Judgement) -> tuple[NamedEffect, ...]:
    """Return the effects of the drive between its command and the measured current."""
    drive = judged.case.drive
    if drive is None:
        return ()
    removed = 1.0 - (drive.after / max(drive.before, 1e-12)) ** 2
    found = []
    if drive.beyond_a_row:
        low, high = drive.lateness - drive.row, drive.lateness
        delay = Interval(0.5 * (low + high), low - drive.step, high + drive.step, "s")
        found.append(("command_delay", {"delay": delay}))
    elif drive.late:
        low, high = drive.delay - drive.step, drive.delay + drive.step
        delay = Interval(drive.delay, max(low, 0.0), high, "s")
        found.append(("command_delay", {"delay": delay}))
    if drive.lagging:
        bandwidth = 1.0 / (2.0 * np.pi * drive.lag)
        value = Interval(bandwidth, 0.7 * bandwidth, 1.4 * bandwidth, "Hz")
        found.append(("current_lag", {"bandwidth": value}))
    other = {"command_delay": "current_lag", "current_lag": "command_delay"}
    return tuple(
        NamedEffect(
            name,
            "drive",
            None,
            None,
            numbers,
            "tentative",
            EVEN_CHANCE,
            removed,
            (other[name],),
            doubt=f"{other[name]} may take its place",
        )
        for name, numbers in found
    )
