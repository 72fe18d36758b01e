"""Which joint predicts best, which effects it has, and how good a prediction could be."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.diagnosis import Horizon
from cjt_gym.gap.horizons.base_rows import base_terms, freed, stated_friction
from cjt_gym.gap.horizons.baseline import least_squares
from cjt_gym.gap.horizons.case import Case, late, sharp
from cjt_gym.gap.horizons.contradiction import contradicted
from cjt_gym.gap.horizons.fit import MOTION, Fit, Problem
from cjt_gym.gap.horizons.found import Found
from cjt_gym.gap.horizons.grow import beyond, is_needed, kept_near
from cjt_gym.gap.horizons.imposed import freed_from
from cjt_gym.gap.horizons.instants import lateness
from cjt_gym.gap.horizons.inverse import ONE_WAY, seen_in_torque
from cjt_gym.gap.horizons.model import Model
from cjt_gym.gap.horizons.own_rows import own_terms
from cjt_gym.gap.horizons.predictable import Predictable
from cjt_gym.gap.horizons.predictable import left as left_by
from cjt_gym.gap.horizons.rivals import REFINED
from cjt_gym.gap.horizons.rows import candidates, cogging, gravity, likelier, scales_of
from cjt_gym.gap.horizons.search import LOUDLY, search
from cjt_gym.gap.horizons.windows import (
    HORIZONS,
    TRIVIAL,
    WHOLE,
    relative,
    worse,
)
from cjt_gym.gap.horizons.worth import Worth, worth
from cjt_gym.gap.recorded.tolerances import OUTSIDE
from cjt_gym.joint import Joint
from cjt_gym.joint.effects import PACKAGED

Floats = NDArray[np.float64]
Key = tuple[str, float]
Progress = Callable[[str], None]
WORSE = 1.02
"""Ratio to the relative error of datasheet or least squares up to which a joint is no worse."""
WORSE_AT_ONCE = 1.2
"""The same at the shortest horizon, which depends more on the measured start than on the joint."""
ORDER = ("stages", "found", "base")
"""Order in which joints are preferred that predict as well."""
SAME = 1.0
"""Cost difference up to which the first of several joints is the answer."""
MISS = 1.25
"""Ratio to the datasheet's relative error above which the stages of a cut joint are rejected: they
fit the offsets and delays of each record, which its joint does not contain."""
CLEARLY = 0.4
"""Logarithm of the mean square by which a search must beat the stages of a cut joint."""
NEAR = 0.2
"""Relative error above which a search looks for a better joint than that of the stages."""
SMALL, HALF = 0.01, 0.5
"""Relative error, and predictable share of its square, above which the stages of a joint whose
torque is not measured leave a search something to find."""
LEFT_SHARE, LEFT_CLEAR = 0.3, 3.0
"""Share of an error, and number of its deviations, above which it counts as predictable."""
MISSED = 0.8
"""Predictable share of the squared error above which the joint that the stages found misses
something, however small the error is."""
DEAFER = 1.0
"""Difference of the logarithm of the torque that displaces a joint by a given error above which
its better predictions do not count against a term of another."""
KEPT = 0.1
"""Relative deviation that the final fit allows the inertia."""
BALANCED = 3
"""Maximum number of times that the weights of horizons where a joint is worse are doubled."""
LOUD = 0.6
"""Relative error, except at the shortest horizon, above which nothing counts as explained."""


@dataclass(frozen=True)
class Row(Horizon):
    """One row of the table of horizons; 0 s stands for a whole piece of a held output.

    Attributes:
        left: Predictable part of the answer's error.
    """

    left: Predictable | None

    @property
    def unexplained(self) -> bool:
        """Whether the remaining error is clearly above the unpredictable part."""
        return self.left is not None and _left(self.found, self.left)


@dataclass(frozen=True, eq=False)
class Judgement:
    """Predictions of several joints, and which joint is the answer.

    Attributes:
        case: The records.
        answer: "datasheet", "least squares", "stages" or "found".
        joint: The joint that is the answer.
        rows: The table of horizons.
        found: Result of the search, if there was one.
        tests: Worth of each term of the search on held-out data.
        problem: The problem that the search was fitted to.
        contradicted: How held-out records contradict those that were fitted, if they do.
        errors: Errors of each joint that was judged, on held-out data.
    """

    case: Case
    answer: str
    joint: Joint
    rows: tuple[Row, ...]
    found: Found | None = None
    tests: tuple[Worth, ...] = ()
    problem: Problem | None = None
    contradicted: str = ""
    errors: dict[str, list[Floats]] = field(default_factory=dict)

    @property
    def cut(self) -> bool:
        """Whether a measured torque cuts the joint into stages."""
        return _cut(self.case)

    @property
    def unexplained(self) -> tuple[Row, ...]:
        """Rows with a predictable remaining error.

        An error at the shortest horizon alone comes from the measured start and does not count if
        everything further ahead is predicted.
        """
        further = [row for row in self.rows if row.seconds != min(HORIZONS)]
        if further and all(row.found < TRIVIAL for row in further):
            return ()
        return tuple(row for row in self.rows if row.unexplained)


def judge(
    case: Case,
    stages: Joint | None,
    progress: Progress,
    suspects: Sequence[str] = (),
    excluded: Collection[str] = (),
    *,
    explained: bool = True,
    timed: bool = False,
) -> Judgement:
    """Return the judgement of a record.

    Args:
        case: The record.
        stages: Joint found by the stages' one-step predictors, judged along with the others.
        progress: Called with a description of the current step.
        suspects: Names of the effects that the stages have found.
        excluded: Names of effects that the record cannot identify; refined laws of friction among
            them are not tried.
        explained: Whether the stages leave nothing unexplained.
        timed: Whether it is known which instants the input belongs to.
    """
    progress("predicting up to half a second ahead")
    scales = scales_of(case.joint, case.logs)
    own = own_terms(case.joint, scales)
    joints = {"datasheet": case.joint}
    ls = least_squares(case.joint, case.logs)
    if ls is not None:
        joints["least squares"] = ls
    if stages is not None:
        joints["stages"] = stages
    enough = NEAR if suspects or not explained else TRIVIAL  # of a held output, over the record
    case = sharp(case, [joints[name] for name in ("datasheet", "stages") if name in joints])
    test = Problem(case.test)
    if stages is not None:
        known = left_by(case.all, stages)
        errors = relative(case.all, case.all.errors(stages))
        open_ = any(_left(errors[key], one) for key, one in known.items())
        worst = max((e for key, e in errors.items() if key[1] != min(HORIZONS)), default=0.0)
        near, loud = worst < NEAR, worst > LOUD
        ahead = [(errors[key], one) for key, one in known.items() if key[1] != min(HORIZONS)]
        missed = any(_left(error, one) and one.share > MISSED for error, one in ahead)
        doubtful = open_ and (loud or missed)
        if _cut(case) and not (own or doubtful or _fails(case, enough, errors)):
            return _settled(case, joints, _sound(case, joints))
        short = any(error > SMALL and one.share > HALF for error, one in ahead)
        whole = errors.get((MOTION, WHOLE), 0.0)  # of a held output, which does not drift
        settled = explained and not (own or open_ or short) and near and whole < TRIVIAL
        settled = settled and not _has_vague_friction(case.joint)
        if settled and _no_worse(case, joints, "stages"):
            return _settled(case, joints, "stages")
    problem = Problem(case.fit)
    base = Model(case.joint, base_terms(case.joint, scales))
    refined = {name for name in excluded if name in (*REFINED, "thermal_derating")}
    seen = seen_in_torque(case.joint, case.logs, {"cogging", *ONE_WAY} & set(excluded))
    given = {t.key for t in base.terms}
    may = [t for t in candidates(case.joint, scales, case.logs) if t.name not in refined]
    may = [t for t in may if t.key not in given]
    may += [cogging(seen["cogging"])] if "cogging" in seen else []
    if "gravity" in seen and not any(t.name == "gravity" for t in may):
        may.append(gravity(case.joint, scales))
    loose = freed(base.terms)
    if not _cut(case) and any(t.name == "gravity" and t.restated for t in may):
        loose = [t for t in loose if t.name != "torque_constant"]  # all but a payload would scale
    terms = likelier([*may, *own, *loose], seen)
    found = search(
        problem, base, terms, suspects, progress,
        lambda one: _tested(problem, test, one)[0], lambda fit: test.scored(fit).cost,
    )  # fmt: skip
    if not timed and (rows := lateness(case, found.fit)) != case.logs[0].usual:
        case = late(case, rows)
        return judge(case, stages, progress, suspects, excluded, explained=explained, timed=True)
    found = _beyond_tolerance(problem, test, found)
    tests = _tested(problem, test, found)[1]
    searched, found = found, _polished(case, problem, found, joints)
    joints["found"] = found.fit.model.at(found.fit.z)
    joints["base"] = found.base.model.at(found.base.z)
    best = _best(case, test, joints, enough)
    if max(relative(case.test, case.test.errors(joints[best])).values()) > 1.0:
        free = replace(problem)
        free.force = 0.0
        fit, plain = (freed_from(free, test, f) for f in ((searched.fit, found.fit), (found.base,)))
        joints["found"], joints["base"] = fit.model.at(fit.z), plain.model.at(plain.z)
        found = replace(found, fit=fit, base=plain)
        best = _best(case, test, joints, enough)
    judged = _settled(case, joints, best)
    return replace(judged, found=found, tests=tests, problem=problem)


def _fails(case: Case, enough: float, errors: dict[Key, float]) -> bool:
    """Return whether the stages leave much of a held output's torque unexplained."""
    held = case.joint.structure_row.output_fixed and case.joint.structure_row.size == 1
    return held and errors.get(("tau", WHOLE), 0.0) > enough


def _cut(case: Case) -> bool:
    """Return whether a measured torque cuts the joint into stages, which makes them sharper."""
    sprung = case.joint.structure_row.has_spring
    return sprung and any("tau" in log.measured for log in case.logs)


def _sound(case: Case, joints: dict[str, Joint]) -> str:
    """Return "stages" unless the datasheet predicts a cut joint clearly better."""
    kinds = [("tau", WHOLE), ("q_m", 0.1), ("q_m", 0.5)]
    own, other = (relative(case.test, case.test.errors(joints[n])) for n in ("stages", "datasheet"))
    worse = any(own[k] > MISS * max(other[k], TRIVIAL) for k in kinds if k in own)
    return "datasheet" if worse else "stages"


def _left(error: float, one: Predictable) -> bool:
    """Return whether an error is clearly above its unpredictable part."""
    return error > TRIVIAL and one.share > LEFT_SHARE and one.share > LEFT_CLEAR * one.deviation


def _tested(problem: Problem, test: Problem, found: Found) -> tuple[Found, tuple[Worth, ...]]:
    """Return a search without terms refuted by held-out data, and the worth of the others."""
    while True:
        new, more = beyond(found.base, found.fit), test.scored(found.fit)
        tests = [
            worth(test, test.scored(less), more, term)
            for less, term in zip(found.less, found.fit.model.terms, strict=True)
        ]
        refuted = [
            k for k in new
            if tests[k].fall < -(LOUDLY if _is_weight(found, k) else 1.0) * tests[k].price
            and not is_needed(found.fit, k)
            and not _deafer(problem, found.less[k], found.fit)
        ]  # fmt: skip
        if not refuted:
            return found, tuple(tests)
        worst = min(refuted, key=lambda k: tests[k].fall)
        found = found.dropped(problem, worst, lambda fit: test.scored(fit).cost)


def _has_vague_friction(joint: Joint) -> bool:
    """Return whether the stages take friction as given that a joint file gives with a tolerance.

    What the friction lacks within it, they find in the torque constant and all that scales with it.
    """
    return bool(stated_friction(joint)) and not joint.structure_row.has_spring


def _is_weight(found: Found, index: int) -> bool:
    """Return whether a term corrects a listed weight: without it, all else scales as well."""
    term = found.fit.model.terms[index]
    return term.name == "gravity" and term.restated


def _beyond_tolerance(problem: Problem, test: Problem, found: Found) -> Found:
    """Return a search in which a freed datasheet value counts as seen if errors show it.

    Without it, the fit strains the datasheet for almost the same value; here it is compared with
    the best fit that leaves the value near the datasheet's.
    """
    worths = list(found.worths)
    for k, term in enumerate(found.fit.model.terms):
        if term.tight is not None and not worths[k].seen:
            near = kept_near(problem, found.fit, k, OUTSIDE)
            held = test.scored(near).cost - test.scored(found.fit).cost
            shown = replace(worth(problem, near, found.fit, term), held=held)
            if shown.enough and shown.seen:
                worths[k] = shown
    return replace(found, worths=tuple(worths))


def _deafer(problem: Problem, less: Fit, more: Fit) -> bool:
    """Return whether a fit responds so much less to its torque that it refutes nothing."""
    if not problem.force:
        return False
    one, other = (problem.deafness(fit.model, fit.z) for fit in (less, more))
    return one - other > DEAFER


def _no_worse(case: Case, joints: dict[str, Joint], name: str) -> bool:
    """Return whether a joint predicts no worse than datasheet and least squares at any horizon.

    Where it predicts worse than motion at constant speed, it must not be worse than the fit without
    effects, either. Nor may bristles help only where it is known how they were bent before.
    """
    parts = [case.test, case.all]
    if "presliding" in joints[name].effects:
        parts.append(case.test.alone())
    for windows in {id(w): w for w in parts}.values():
        errors = windows.errors(joints[name])
        own = relative(windows, errors)
        slack = {key: _slack(key) for key in windows.keys}
        for other in {"datasheet", "least squares", "base"} & joints.keys() - {name}:
            lost = worse(windows, errors, windows.errors(joints[other]), slack)
            if lost and (
                other != "base" or any(own[k] > 1.0 for k in lost if k[1] > min(HORIZONS))
            ):
                return False
    return True


def _slack(key: Key) -> float:
    """Return the ratio to another joint's relative error up to which a joint is no worse."""
    return WORSE_AT_ONCE if key[1] == min(HORIZONS) else WORSE


def _polished(case: Case, problem: Problem, found: Found, joints: dict[str, Joint]) -> Found:
    """Return a search refitted to predict best, with its inertia nearly unchanged.

    Horizons at which it would be worse than datasheet or least squares get more weight.
    """
    problem = replace(problem)
    problem.force = 0.0
    model, z = _with_inertia_kept(found.fit.model, found.fit.z)
    limits = [relative(case.fit, case.fit.errors(joints[n])) for n in joints if n != "stages"]
    fit = problem.fit(model, z)
    for _ in range(BALANCED):
        errors = dict(zip(case.fit.keys, fit.relative(), strict=True))
        worse = [any(errors[key] > limit[key] for limit in limits) for key in case.fit.keys]
        if not any(worse):
            break
        problem.weights = problem.weights * np.where(worse, 2.0, 1.0)
        problem.weights /= problem.weights.sum()
        fit = problem.fit(model, fit.z)
    return replace(found, fit=fit)


def _with_inertia_kept(model: Model, z: Floats) -> tuple[Model, Floats]:
    """Return a model whose inertia is held near its current value, and coordinates."""
    terms, z = [], z.copy()
    for k, (term, values) in enumerate(zip(model.terms, model.values(z), strict=True)):
        if term.name == "inertia":
            number = replace(term.numbers[0], start=values[0], scale=KEPT)
            term = replace(term, numbers=(number,))
            z[model.span(k)] = 0.0
        terms.append(term)
    return replace(model, terms=tuple(terms)), z


def _best(case: Case, test: Problem, joints: dict[str, Joint], enough: float) -> str:
    """Return the name of the joint that is the answer."""
    blank = Model(case.joint)
    errors = {name: case.test.errors(joint) for name, joint in joints.items()}
    costs = {name: test.cost(blank, np.zeros(0), e) for name, e in errors.items()}
    sound = [n for n in joints if _no_worse(case, joints, n)]
    if "stages" in joints and not _cut(case) and _deaf(case, errors["stages"]):
        joints = {n: joint for n, joint in joints.items() if n != "stages"}
        sound = [n for n in sound if n != "stages"]
    vague = _has_vague_friction(case.joint)
    for name in (n for n in (("found", "base", "stages") if vague else ORDER) if n in joints):
        others = [costs[n] for n in sound if n != name]
        cut = name == "stages" and _cut(case)
        if cut and "found" in sound and _loses(case, enough, errors["stages"], errors["found"]):
            continue
        sharper = cut and not _own(joints.get("found"), case.joint)
        sharper = sharper or (vague and name != "stages")
        allowance = CLEARLY * test.strength if sharper else SAME
        if (name in sound or cut) and costs[name] <= min(others, default=np.inf) + allowance:
            return name
    return min(sound or ("datasheet", "least squares") & joints.keys(), key=lambda n: costs[n])


def _loses(case: Case, enough: float, stages: Sequence[Floats], found: Sequence[Floats]) -> bool:
    """Return whether a search predicts whole pieces of a held output clearly better."""
    own, other = (relative(case.test, errors) for errors in (stages, found))
    whole = [key for key in own if key[1] == WHOLE and own[key] > enough]
    return any(2.0 * np.log(own[key] / max(other[key], TRIVIAL)) > CLEARLY for key in whole)


def _own(found: Joint | None, nominal: Joint) -> bool:
    """Return whether a search has found an effect unknown to the stages."""
    return found is not None and not PACKAGED.issuperset(found.effects.keys() - nominal.effects)


def _deaf(case: Case, errors: Sequence[Floats]) -> bool:
    """Return whether a joint hardly predicts its angle over the longest horizon."""
    return relative(case.test, errors).get(("q_m", max(HORIZONS)), 0.0) > LOUD


def _settled(case: Case, joints: dict[str, Joint], best: str) -> Judgement:
    """Return the judgement with a joint as its answer."""
    errors = {name: case.test.errors(joint) for name, joint in joints.items()}
    table = {name: relative(case.test, e) for name, e in errors.items()}
    known = left_by(case.all, joints[best])
    rows = []
    for key in case.test.keys:
        left = known.get(key)
        enough = left is not None and left.deviation < 1.0
        floor = table[best][key] * (1.0 - left.share) ** 0.5 if left is not None else None
        rows.append(
            Row(
                key[1], key[0], table["datasheet"][key],
                table["least squares"][key] if "least squares" in table else None,
                table[best][key], floor if enough else None, left if enough else None,
            )
        )  # fmt: skip
    said = contradicted(case, joints, table)
    return Judgement(case, best, joints[best], tuple(rows), contradicted=said, errors=errors)
