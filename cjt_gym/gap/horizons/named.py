"""Which terms of a search are named, with which status, numbers and rivals."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.diagnosis import EVEN_CHANCE, LEVELLESS, MUCH_LEFT, Interval, NamedEffect
from cjt_gym.gap.horizons.by_torque import AGREES, agrees, either, inertia_by_torque
from cjt_gym.gap.horizons.fit import MOTION, Fit
from cjt_gym.gap.horizons.grow import is_needed, leave
from cjt_gym.gap.horizons.held import held_alike
from cjt_gym.gap.horizons.inverse import DRAGS, feels_weight, inverse, swinging
from cjt_gym.gap.horizons.judge import LOUD, Judgement
from cjt_gym.gap.horizons.model import Term
from cjt_gym.gap.horizons.rows import scales_of
from cjt_gym.gap.horizons.scatter import Scatter
from cjt_gym.gap.horizons.sheet import stated_tolerance
from cjt_gym.gap.horizons.spent import Spent
from cjt_gym.gap.horizons.spread import Spread, spread_of
from cjt_gym.gap.horizons.verdict import LATE, is_unknown, is_usual_offset, worst_row
from cjt_gym.gap.horizons.windows import HORIZONS
from cjt_gym.gap.recorded.tolerances import OUTSIDE, is_left_open

SURE, FIRM = 1.4, 2.0
"""Multiples of the required clarity and price above which an effect may be confirmed."""
LOUDEST = 10.0
"""Multiple of its price by which an effect that the examination excludes must lower the cost to be
named at all, tentatively."""
STRAINED = 2.5
"""Number of stated tolerances up to which the other datasheet values may be off where an effect is
confirmed: beyond that, something else is missing that they make up for."""
SLIGHT = 0.02
"""Relative change of a datasheet value that strains none, however narrow its tolerance is."""
MIMICS = frozenset({"gravity", "viscous_asym", "load_friction"})
"""Effects that position or a wrong input may mimic: confirmed only if they remove more than
`MUCH` of the error."""
STRAIGHT = 0.5
"""Travel up to which a weight pulls like a spring beside the joint [rad]: the sine of an angle is
a line there but for 3 % of the weight."""
SCALED = frozenset({"torque_gain", "torque_constant"})
"""Effects that are dropped if their number ends at a bound, which no sensor or motor reaches."""
LEVELS = frozenset({"coulomb", "coulomb_asym", "load_coulomb"})
"""Dry friction that remains at speed; without it, Stribeck friction would fall to zero."""
PLAIN, REFINEMENTS = frozenset({"coulomb", "load_coulomb"}), frozenset({"presliding", "stribeck"})
"""Plain dry friction, and laws that are told together with it."""
VISIBLE = 0.3
"""Presliding displacement, relative to the error at the shortest horizon, that is visible."""
MIRRORED = 1.5
"""Ratio of the friction in the two directions up to which both are nearly the same."""
LEAST_LEVEL = 0.2
"""Least friction that remains at speed, relative to the additional friction at rest."""
SCALES = frozenset({"inertia", "torque_constant"})
"""Datasheet values that make up for heat of which the record does not tell when it began."""
ALIKE = 0.1
"""Logarithm of the ratio of two inertias up to which they are alike."""
FELT = 0.2
"""Relative difference up to which a regression has the same friction."""
MUCH = 0.5
"""Share of the squared error that an effect of `MIMICS` must remove."""
NOTHING = 1e-3
"""Share of a search step by which an effect must differ from no effect."""
SKEW = frozenset({"coulomb_asym", "viscous_asym", "torque_offset"})
"""Effects that depend on the direction; several of them together compensate each other."""
COMBINED = ("gravity", "viscous_asym")
"""Effects whose numbers in the effect table are combinations of the fitted ones."""


def effects_of(
    judged: Judgement, excluded: Mapping[str, str], seen: Mapping[str, Spent]
) -> tuple[NamedEffect, ...]:
    """Return the effects to name, sorted by the share of the error that they remove."""
    if judged.found is None or judged.problem is None or judged.answer == "datasheet":
        return of_drive(judged)
    found, spread = judged.found, spread_of(judged.problem, judged.found.fit)
    named = []
    for k, term in enumerate(found.fit.model.terms):
        there = judged.answer == "found" or term.name in judged.joint.effects
        open_ = term.name in excluded and not _is_overwhelming(judged, k, excluded)
        at_once = term.name in LATE and _follows_at_once(judged)
        if at_once or open_ or not (there and term.told):
            continue
        if _deserves(judged, k, term, seen):
            effect = _named(judged, spread, k, term)
            if _may_be_as_stated(spread, term, effect) or _is_open(judged, effect):
                continue
            named.append(_regressed(judged, effect) if judged.answer == "least squares" else effect)
    named += [e for e in of_drive(judged) if e.name not in {n.name for n in named}]
    named = [_as_plain(effect) for effect in _folded(named) if effect.parameters]
    return tuple(sorted(named, key=lambda e: -e.gap_removed))


def _follows_at_once(judged: Judgement) -> bool:
    """Return whether a measured current follows its command without delay and lag.

    Any delay between current and motion then lies in the instants of the rows.
    """
    drive = judged.case.drive
    at_once = drive is not None and not (drive.late or drive.lagging)
    return at_once and judged.case.logs[0].drive == "i"


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


def _as_plain(effect: NamedEffect) -> NamedEffect:
    """Return nearly symmetric dry friction as plain Coulomb friction if that fits as well."""
    plain = "coulomb" in effect.confusable_with
    if effect.name != "coulomb_asym" or not plain or len(effect.parameters) != 2:
        return effect
    symbol, (one, two) = next(iter(effect.parameters)), effect.parameters.values()
    small, large = sorted((abs(one.value), abs(two.value)))
    if large > MIRRORED * small:
        return effect
    low, high = min(one.low, two.low), max(one.high, two.high)
    both = replace(one, value=0.5 * (one.value + two.value), low=low, high=high)
    others = tuple(n for n in effect.confusable_with if n != "coulomb")
    return replace(
        effect, name="coulomb", parameters={symbol: both}, confusable_with=(effect.name, *others)
    )


def _deserves(judged: Judgement, index: int, term: Term, seen: Mapping[str, Spent]) -> bool:
    """Return whether a term is supported and deviates beyond what the datasheet allows."""
    assert judged.found is not None
    found = judged.found
    values = found.fit.model.values(found.fit.z)[index]
    worth = found.worths[index]
    told = (worth.enough and worth.seen) or is_needed(found.fit, index)
    told = told or (worth.enough and term.restated and _is_felt(judged, term, values))
    if term.name == "presliding" and not _bends_visibly(judged, index):
        return False
    if not told and not agrees(seen.get(term.name), values):
        return False
    if term.name == "gravity" and "gravity" not in seen and not _weighs(judged, values):
        return False
    if term.name in SCALED and not term.numbers[0].low < values[0] < term.numbers[0].high:
        return False
    if is_usual_offset(judged, term.name, values[0]):
        return False
    as_given = {t.key: t for t in found.base.model.terms}  # the final fit holds the inertia
    number = as_given.get(term.key, term).numbers[0]
    if number.prior:
        tolerance = stated_tolerance(judged.case.joint, term)
        if tolerance is None and number.scale >= 0.5:
            return False  # a guess is corrected, not diagnosed
        ratios = [x / term.nominal[0] for x in (values[0], *inertia_by_torque(judged, term))]
        off = [max(r - 1.0, np.log(r)) if r > 1.0 else np.log(r) for r in ratios]
        nearest = min(np.abs(off)) if min(off) * max(off) > 0.0 else 0.0
        return bool(nearest > OUTSIDE * (tolerance or number.scale))
    pairs = zip(values, term.nominal, term.numbers, strict=True)
    return any(abs(value - off) > NOTHING * n.scale for value, off, n in pairs)


def _is_felt(judged: Judgement, term: Term, values: Sequence[float]) -> bool:
    """Return whether a value that left its tolerance is also the torque's.

    Predictions alone may hold a wrong inertia against a torque constant that is off by as much.
    """
    value = values[0]
    if felt := inertia_by_torque(judged, term):
        return all(abs(np.log(x / value)) < ALIKE for x in felt)
    if term.name == "gravity":
        return _weighs(judged, values)
    if term.name not in DRAGS or term.body != "motor":
        return False
    found = inverse(judged.case.joint, judged.case.logs)
    by = {
        "damping": [x.damping for x in found],
        "coulomb": [x.effects["coulomb"][0] for x in found],
    }
    return any(abs(x - value) < FELT * value for x in by[term.name])


def _may_be_as_stated(spread: Spread, term: Term, effect: NamedEffect) -> bool:
    """Return whether the interval of a datasheet value includes what the datasheet states."""
    symbol = term.numbers[0].symbol
    if not term.nominal[0] or symbol not in effect.parameters:
        return False
    one = effect.parameters[symbol]
    return one.low <= spread.stated(term, term.nominal[0]) <= one.high


def _is_open(judged: Judgement, effect: NamedEffect) -> bool:
    """Return whether an effect is no more than values that the datasheet leaves open."""
    values = {symbol: one.value for symbol, one in effect.parameters.items()}
    return is_left_open(judged.case.joint.file, effect.name, values)


def _weighs(judged: Judgement, values: Sequence[float]) -> bool:
    """Return whether the motor's torque shows about the weight that a fit has.

    A single mass that is driven feels its whole weight there. One that only predictions show makes
    up for something else, such as friction that is not as the table has it.
    """
    joint, logs = judged.case.joint, judged.case.logs
    if scales_of(joint, logs).coasts:
        return True
    known = [e["gravity"] for e in (x.effects for x in inverse(joint, logs)) if "gravity" in e]
    if joint.structure_row.size > 1 or not known:
        return True
    known += [own] if (own := swinging(joint, logs)) is not None else []
    off = min(np.hypot(x - values[0], y - values[1]) for x, y in known)
    return bool(off < AGREES * np.hypot(values[0], values[1]))


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
    assert judged.found is not None
    found = judged.found
    worth, test = found.worths[index], judged.tests[index] if judged.tests else None
    rivals = found.rivals[index] if index < len(found.rivals) else ()
    genuine = tuple(r for r in rivals if r not in NESTED.get(term.name, ()))
    same = tuple(n for n in either(term.name, judged.case.joint) if n not in genuine)
    names = {t.name for t in found.fit.model.terms}
    if term.name == "coulomb" and "torque_offset" in names:
        same = ("coulomb_asym",)
    if term.name in SKEW and len(SKEW & names) > 1:
        same = tuple(sorted(SKEW - {term.name}))
    same = (*same, *held_alike(term.name, judged.joint, judged.case.logs[0]))
    if term.name == "gravity" and scales_of(judged.case.joint, judged.case.logs).travel < STRAIGHT:
        same = (*same, "contact")
    if term.name == "gravity" and term.restated:
        same = (*same, "torque_constant")
    delayed = term.name in LATE and judged.case.logs[0].drive != "i"
    if delayed:
        same = (*same, *(LATE - {term.name}))
    removed = _removed(found.less[index], found.fit)
    felt = term.restated and not worth.seen  # by the torque: others make up for it
    if felt and judged.problem is not None:
        z = found.fit.z.copy()
        z[found.fit.model.span(index)] = [
            n.coordinate(x) for n, x in zip(term.numbers, term.nominal, strict=True)
        ]
        removed = _removed(judged.problem.at(found.fit.model, z), found.fit)
    alike = tuple(dict.fromkeys((*genuine, *same)))
    slight = worth.clear <= SURE * worth.needed or worth.fall <= FIRM * worth.price
    mimicked = term.name in MIMICS and removed <= MUCH
    strained = _strained(judged, term)
    lagging = judged.case.logs[0].voltage and term.name not in LATE and bool(LATE & names)
    by_voltage = judged.case.logs[0].voltage and term.name == "torque_constant"
    heated = term.name in SCALES and "thermal_derating" in names
    endless = term.name == "stribeck" and not _levelled(found.fit, index)
    doubts = (
        (bool(alike), f"{' or '.join(alike)} may take its place"),
        (felt, "other values of the datasheet, off in proportion, may take its place"),
        (slight, "the record shows it in few places, or only just"),
        (test is not None and test.fall <= 0.0, "held-out data do not call for it"),
        (mimicked, "an error of the input or the angle may look like it"),
        (_is_unfelt(judged, term), "the torque does not show it"),
        (endless, LEVELLESS),
        (lagging, "what delays its voltage stays open"),
        (by_voltage, "damping and inertia, off together, may take its place"),
        (heated, "how warm the motor was when the log began stays open"),
        (delayed, "without the measured current, slow mechanics look the same"),
        (bool(judged.unexplained) or worst_row(judged).found >= LOUD, MUCH_LEFT),
        (is_unknown(worst_row(judged)), "this record does not tell how much stays unexplained"),
        (bool(strained), f"{' and '.join(strained)} had to leave its tolerance beside it"),
    )
    doubt = next((why for holds, why in doubts if holds), "")
    clear = worth.needed if felt else worth.clear
    confidence = float(np.clip(1.0 - 0.5 ** (clear / worth.needed), 0.05, 0.99))
    effect = NamedEffect(
        term.name, term.stage, term.body, term.channel, _intervals(judged, spread, index),
        "confirmed", confidence, removed, alike, worth.fall,
    )  # fmt: skip
    return effect.doubted(doubt) if doubt else effect


def _is_unfelt(judged: Judgement, term: Term) -> bool:
    """Return whether the torque of a single mass does not show its weight.

    Where the input is noisy, a pull to the middle of the motion makes predictions drift less.
    """
    single = judged.case.joint.structure_row.size == 1
    weighs = term.name == "gravity" and single
    return weighs and not feels_weight(judged.case.joint, judged.case.logs)


def _is_overwhelming(judged: Judgement, index: int, excluded: Collection[str]) -> bool:
    """Return whether an effect that one record can hardly show is seen far beyond doubt.

    Damping and Coulomb friction that the record does not tell apart need not show in many places,
    and count together, as each may do most of what the other did.
    """
    assert judged.found is not None
    assert judged.problem is not None
    found, term = judged.found, judged.found.fit.model.terms[index]
    less, worth = found.less[index], found.worths[index]
    if term.name in DRAGS and term.body == "motor" and DRAGS.issubset(excluded):
        left = [k for k, t in enumerate(less.model.terms) if t.name in DRAGS and t.body == "motor"]
        less = leave(judged.problem, less, left[0]) if left else less
        loud = less.cost - found.fit.cost > LOUDEST * worth.price
        return loud and _removed(less, found.fit) > MUCH
    clear = worth.clear > SURE * worth.needed and worth.fall > LOUDEST * worth.price
    return clear and _removed(less, found.fit) > MUCH


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


def _bends_visibly(judged: Judgement, index: int) -> bool:
    """Return whether presliding moves by more than part of the error at the shortest horizon."""
    assert judged.found is not None
    fit, windows = judged.found.fit, judged.case.test
    key = (MOTION, min(HORIZONS))
    if key not in windows.keys:
        return True
    (sigma,) = fit.model.values(fit.z)[index]
    pairs = zip(fit.model.terms, fit.model.values(fit.z), strict=True)
    levels = [abs(v) for term, values in pairs if term.name in LEVELS for v in values]
    at = windows.keys.index(key)
    error = fit.relative()[judged.case.fit.keys.index(key)] * float(np.sqrt(windows.scales[at]))
    return bool(max(levels, default=np.inf) / sigma > VISIBLE * error)


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


NESTED: Mapping[str, tuple[str, ...]] = {
    "coulomb": ("coulomb_asym", "stribeck", "presliding"),
    "damping": ("viscous_asym",),
    "torque_offset": ("gravity",),
}
"""Rivals of which a term is a special case."""


def _removed(less: Fit, more: Fit) -> float:
    """Return the largest share of the squared error of any kind that a term removes."""
    one, two = less.relative() ** 2, more.relative() ** 2
    return float(np.clip(np.max((one - two) / np.maximum(one, 1e-12)), 0.0, 1.0))


def of_drive(judged: Judgement) -> tuple[NamedEffect, ...]:
    """Return the effects of the drive between its command and the measured current."""
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
