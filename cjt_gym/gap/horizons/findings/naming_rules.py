"""Which terms of a search may be named."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from cjt_gym.gap.diagnosis import NamedEffect
from cjt_gym.gap.horizons.findings.by_torque import AGREES, agrees, inertia_by_torque
from cjt_gym.gap.horizons.findings.corrected_values import is_far_off, is_usual_offset
from cjt_gym.gap.horizons.fitting.datasheet import stated_tolerance
from cjt_gym.gap.horizons.fitting.fit import MOTION, Fit
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import Spread
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.gap.horizons.prediction.windows import HORIZONS
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.horizons.selection.stepwise import is_needed, leave
from cjt_gym.gap.horizons.selection.worth import worth
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.horizons.torque.inverse import DRAGS, inverse, swinging
from cjt_gym.gap.recorded.tolerances import OUTSIDE, is_left_open

SURE = 1.4
"""Multiple of the required clarity above which an effect may be confirmed."""
LOUDEST = 10.0
"""Multiple of its price by which an effect that the examination excludes must lower the cost to be
named at all, tentatively."""
SCALED = frozenset({"torque_gain", "torque_constant"})
"""Effects that are dropped if their number ends at a bound, which no sensor or motor reaches."""
LEVELS = frozenset({"coulomb", "coulomb_asym", "load_coulomb"})
"""Dry friction that remains at speed; without it, Stribeck friction would fall to zero."""
VISIBLE = 0.3
"""Presliding displacement, relative to the error at the shortest horizon, that is visible."""
ALIKE = 0.1
"""Logarithm of the ratio of two inertias up to which they are alike."""
FELT = 0.2
"""Relative difference up to which a regression has the same friction."""
MUCH = 0.5
"""Share of the squared error that an effect which others may mimic must remove."""
SEVERAL = 2.0
"""Multiple of its price by which two laws that share the friction must lower the cost together."""
NOTHING = 1e-3
"""Share of a search step by which an effect must differ from no effect."""


def is_named(
    judged: Judgement,
    index: int,
    term: Term,
    seen: Mapping[str, Spent],
    *,
    alone: bool = False,
    shared: bool = False,
) -> bool:
    """Return whether a term is supported and deviates beyond what the datasheet allows.

    Args:
        judged: The judgement.
        index: Index of the term.
        term: The term.
        seen: Effects that a regression of the torque shows.
        alone: Whether no other term is named although predictions are much better: what left a
            stated tolerance by far is then named even if few places show it.
        shared: Whether it is one of two laws that the record supports together, as `shares` says.
    """
    assert judged.found is not None
    found = judged.found
    values = found.fit.model.values(found.fit.z)[index]
    own = found.worths[index]
    told = (own.enough and own.seen) or own.repeated or is_needed(found.fit, index)
    told = told or (own.enough and term.restated and _is_felt(judged, term, values))
    if term.name == "presliding" and not _bends_visibly(judged, index):
        return False
    told = told or shared or agrees(seen.get(term.name), values)
    if not (told or (alone and is_far_off(judged, term, values[0]))):
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


def shares(judged: Judgement, index: int) -> str:
    """Return the law of friction with which a term does what neither need do alone, "" if none.

    Damping and dry friction of a motor may each take the other's place, so that leaving out one
    costs little, and leaving out both much.
    """
    assert judged.found is not None
    assert judged.problem is not None
    found = judged.found
    drags = [k for k, t in enumerate(found.fit.model.terms) if _is_drag(t)]
    if index not in drags or len(drags) < 2:
        return ""
    if any(found.worths[k].enough and found.worths[k].seen for k in drags):
        return ""
    less, key = found.less[index], found.fit.model.terms[index].key  # a listed one stays in it
    others = (k for k, t in enumerate(less.model.terms) if _is_drag(t) and t.key != key)
    if (other := next(others, None)) is None:
        return ""
    both = worth(
        judged.problem, leave(judged.problem, less, other), found.fit, found.fit.model.terms[index]
    )
    if both.fall <= SEVERAL * both.price or both.clear <= both.needed:
        return ""
    return less.model.terms[other].name


def _is_drag(term: Term) -> bool:
    return term.name in DRAGS and term.body == "motor"


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


def may_be_as_stated(spread: Spread, term: Term, effect: NamedEffect, misfit: float = 1.0) -> bool:
    """Return whether the interval of a datasheet value includes what the datasheet states.

    What a model lacks may carry the value beyond that interval, in proportion to the misfit. A wave
    of no height, whatever its frequency, is no such value.
    """
    symbol = term.numbers[0].symbol
    if not all(term.nominal) or symbol not in effect.parameters:
        return False
    one, stated = effect.parameters[symbol], spread.stated(term, term.nominal[0])
    low, high = (one.value + misfit * (end - one.value) for end in (one.low, one.high))
    return low <= stated <= high


def is_open(judged: Judgement, effect: NamedEffect) -> bool:
    """Return whether an effect is no more than values that the datasheet leaves open."""
    values = {symbol: one.value for symbol, one in effect.parameters.items()}
    return is_left_open(judged.case.joint.file, effect.name, values)


def follows_at_once(judged: Judgement) -> bool:
    """Return whether a measured current follows its command without delay and lag.

    Any delay between current and motion then lies in the instants of the rows.
    """
    drive = judged.case.drive
    at_once = drive is not None and not (drive.late or drive.lagging)
    return at_once and judged.case.logs[0].drive == "i"


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


def is_overwhelming(judged: Judgement, index: int, excluded: Collection[str]) -> bool:
    """Return whether an effect that one record can hardly show is seen far beyond doubt.

    Damping and Coulomb friction that the record does not tell apart need not show in many places,
    and count together, as each may do most of what the other did.
    """
    assert judged.found is not None
    assert judged.problem is not None
    found, term = judged.found, judged.found.fit.model.terms[index]
    less, own = found.less[index], found.worths[index]
    if _is_drag(term) and DRAGS.issubset(excluded):
        left = [k for k, t in enumerate(less.model.terms) if _is_drag(t)]
        less = leave(judged.problem, less, left[0]) if left else less
        loud = less.cost - found.fit.cost > LOUDEST * own.price
        return loud and share_removed(less, found.fit) > MUCH
    clear = own.clear > SURE * own.needed and own.fall > LOUDEST * own.price
    return clear and share_removed(less, found.fit) > MUCH


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


def share_removed(less: Fit, more: Fit) -> float:
    """Return the largest share of the squared error of any kind that a term removes."""
    one, two = less.relative() ** 2, more.relative() ** 2
    return float(np.clip(np.max((one - two) / np.maximum(one, 1e-12)), 0.0, 1.0))
