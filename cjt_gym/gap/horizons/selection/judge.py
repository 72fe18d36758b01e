"""Which joint predicts best, which effects it has, and how good a prediction could be."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fitting.balanced_friction import is_delicate, limited
from cjt_gym.gap.horizons.fitting.base_terms import base_terms, freed
from cjt_gym.gap.horizons.fitting.fit import MOTION, Fit, Problem
from cjt_gym.gap.horizons.fitting.imposed_motion import AT_ALL, freed_from
from cjt_gym.gap.horizons.fitting.input_instants import lateness
from cjt_gym.gap.horizons.fitting.terms import candidates, cogging, gravity, likelier, scales_of
from cjt_gym.gap.horizons.fitting.user_effects import own_terms
from cjt_gym.gap.horizons.prediction.case import Case, by_angle, late, sharp
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.predictable import left as left_by
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, relative
from cjt_gym.gap.horizons.selection.choice import (
    are_sound,
    best_of,
    cost_of,
    fails,
    has_vague_friction,
    is_no_worse,
)
from cjt_gym.gap.horizons.selection.contradiction import contradicted
from cjt_gym.gap.horizons.selection.judgement import LOUD, NEAR, SLIGHT, Judgement, Row, is_left
from cjt_gym.gap.horizons.selection.rivals import REFINED
from cjt_gym.gap.horizons.selection.search import search
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.selection.starts import best_start
from cjt_gym.gap.horizons.selection.stepwise import beyond, is_needed, kept_near
from cjt_gym.gap.horizons.selection.worth import LOUDLY, Worth, worth
from cjt_gym.gap.horizons.torque.baseline import least_squares
from cjt_gym.gap.horizons.torque.dead_time import DELAY
from cjt_gym.gap.horizons.torque.inverse import ONE_WAY, is_inertia_alone_off, seen_in_torque
from cjt_gym.gap.horizons.torque.over_angle import over_angle, wave_of
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.tolerances import OUTSIDE
from cjt_gym.joint import Joint
from cjt_gym.joint.kernel.arrays import Floats

Progress = Callable[[str], None]
SMALL, HALF = 0.01, 0.5
"""Relative error, and predictable share of its square, above which the stages of a joint whose
torque is not measured leave a search something to find."""
MISSED = 0.8
"""Predictable share of the squared error above which the joint that the stages found misses
something, however small the error is."""
DEAFER = 1.0
"""Difference of the logarithm of the torque that displaces a joint by a given error above which
its better predictions do not count against a term of another."""
KEPT = 0.1
"""Relative deviation that the final fit allows the inertia."""
CONSTANT = "torque_constant"
"""What all other values make up for, off in proportion, where no torque is measured."""
SHARPER = 0.7
"""Cost of other states, relative to those that suit the datasheet, from which a fit takes them: it
is halved or more where a guess was far off."""
BALANCED = 3
"""Maximum number of times that the weights of horizons where a joint is worse are doubled."""


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
    own = own_terms(case.joint, scales_of(case.joint, case.logs))
    if stages is not None and is_delicate(case.fit, stages):
        stages, suspects = None, ()
    if (
        CONSTANT in suspects
        and case.cut is not Cut.BY_TORQUE
        and is_inertia_alone_off(case.joint, case.logs)
    ):
        stages, suspects = None, [name for name in suspects if name != CONSTANT]
    joints = {"datasheet": case.joint}
    ls = least_squares(case.joint, case.logs)
    if ls is not None:
        joints["least squares"] = ls
    if stages is not None:
        joints["stages"] = stages
    enough = NEAR if suspects or not explained else TRIVIAL  # of a held output, over the record
    case = sharp(case, [joints[name] for name in ("datasheet", "stages") if name in joints])
    if stages is not None and _suffices(case, joints, own, enough, explained):
        return _settled(case, joints, "stages")
    base, terms = _proposed(case, own, excluded, stages)
    plain = best_start(Problem(case.fit), base)
    case = sharp(case, [plain.model.at(plain.z)], SHARPER)
    problem, test = Problem(case.fit), Problem(case.test)

    def searched_with(base: Model, terms: Sequence[Term], suspects: Sequence[str]) -> Found:
        return search(
            problem, base, terms, suspects, progress,
            lambda one: _tested(problem, test, one)[0], lambda fit: test.scored(fit).cost,
        )  # fmt: skip

    found = searched_with(base, terms, suspects)
    if is_delicate(case.fit, found.fit.model.at(found.fit.z)):
        peak = scales_of(case.joint, case.logs).peak
        start = replace(base, terms=tuple(limited(base.terms, peak)))
        found = searched_with(start, limited(terms, peak), ())
    if not timed and (rows := lateness(case, found.fit)) != case.logs[0].usual:
        case = late(case, rows)
        if case.logs[0].early:  # the stages took the current as it was logged
            stages, suspects = None, ()
        return judge(case, stages, progress, suspects, excluded, explained=explained, timed=True)
    found = _beyond_tolerance(problem, test, found)
    tests = _tested(problem, test, found)[1]
    searched, found = found, _polished(case, problem, test, found, joints)
    joints["found"] = found.fit.model.at(found.fit.z)
    joints["base"] = found.base.model.at(found.base.z)
    best = best_of(case, test, joints, enough)
    if max(relative(case.test, case.test.errors(joints[best])).values()) > AT_ALL:
        if any(log.with_speed and not log.from_slope for log in case.logs):
            case = by_angle(case)
            return judge(
                case, stages, progress, suspects, excluded, explained=explained, timed=True
            )  # fmt: skip
        free = replace(problem)
        free.force = 0.0
        fit, plain = (freed_from(free, test, f) for f in ((searched.fit, found.fit), (found.base,)))
        freed = joints | {"found": fit.model.at(fit.z), "base": plain.model.at(plain.z)}
        other = best_of(case, test, freed, enough)
        worse = [
            cost_of(case, x, freed[other]) - cost_of(case, x, joints[best])
            for x in (test, Problem(case.all))
        ]
        if worse[0] <= 0.0 and sum(worse) <= 0.0:  # held-out and fitted motion
            joints, best, found = freed, other, replace(found, fit=fit, base=plain)
    if best == "found":
        finer = _finer(case, problem, found)
        closer = joints | {"found": finer.fit.model.at(finer.fit.z)}
        if best_of(case, test, closer, enough) == best:
            joints, found = closer, finer
    judged = _settled(case, joints, best)
    return replace(judged, found=found, tests=tests, problem=problem)


def _suffices(
    case: Case, joints: dict[str, Joint], own: Sequence[Term], enough: float, explained: bool
) -> bool:
    """Return whether the joint of the stages needs no search."""
    known = left_by(case.all, joints["stages"])
    errors = relative(case.all, case.all.errors(joints["stages"]))
    open_ = any(is_left(errors[key], one) for key, one in known.items())
    worst = max((e for key, e in errors.items() if key[1] != min(HORIZONS)), default=0.0)
    ahead = [(errors[key], one) for key, one in known.items() if key[1] != min(HORIZONS)]
    missed = any(is_left(error, one) and one.share > MISSED for error, one in ahead)
    doubtful = open_ and (worst > LOUD or missed)
    if not case.joint.file.sensors.get("i"):  # what the stages take for noise may be an effect
        doubtful = doubtful or any(error > SLIGHT and one.share > HALF for error, one in ahead)
    unseen = not case.joint.structure_row.output_fixed and "q_l" not in case.logs[0].measured
    doubtful = doubtful or (unseen and worst > NEAR)  # the load, which no stage judges then
    if case.cut is Cut.BY_TORQUE and not (own or doubtful or fails(case, enough, errors)):
        return are_sound(case, joints)
    short = any(error > SMALL and one.share > HALF for error, one in ahead)
    whole = errors.get((MOTION, WHOLE), 0.0)  # of a held output, which does not drift
    unsure = doubtful if case.cut is Cut.BY_ANGLES else open_ or short
    settled = explained and not (own or unsure) and worst < NEAR and whole < TRIVIAL
    settled = settled and not has_vague_friction(case.joint)
    settled = settled and not _misses_wave(case, joints["stages"])
    return settled and is_no_worse(case, joints, "stages")


def _misses_wave(case: Case, joint: Joint) -> bool:
    """Return whether the torque repeats with the motor's angle, and that of a joint does not."""
    known = {"cogging", "gear_ripple"} & joint.effects.keys()
    return not known and over_angle(case.joint, case.logs) is not None


def _proposed(
    case: Case, own: Sequence[Term], excluded: Collection[str], stages: Joint | None
) -> tuple[Model, list[Term]]:
    """Return the datasheet's model, and the terms that a search may add to it.

    It cannot find the frequency of a wave over the angle, which a regression or the stages tell.
    """
    scales = scales_of(case.joint, case.logs)
    alone = case.cut is not Cut.BY_TORQUE and is_inertia_alone_off(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales, inertia_alone_off=alone))
    refined = {name for name in excluded if name in (*REFINED, "thermal_derating")}
    seen = seen_in_torque(case.joint, case.logs, {"cogging", *ONE_WAY} & set(excluded))
    given = {t.key for t in base.terms}
    may = [t for t in candidates(case.joint, scales, case.logs) if t.name not in refined]
    may = [t for t in may if t.key not in given]
    wave = seen.get("cogging") or wave_of(stages, case.joint, case.logs)
    may += [cogging(wave)] if wave is not None else []
    shown = "gravity" in seen or "gravity" not in excluded
    if shown and not any(t.name == "gravity" for t in may):
        may.append(gravity(case.joint, scales))
    loose = freed(base.terms)
    weighed = any(t.name == "gravity" and t.restated for t in may)
    if alone or (weighed and case.cut is not Cut.BY_TORQUE):
        loose = [t for t in loose if t.name != CONSTANT]  # all but one value would scale with it
    late = {"current_lag"} if DELAY in seen else set()  # the torque tells them apart no better
    return base, likelier([*may, *own, *loose], {*seen, *late})


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


def _is_weight(found: Found, index: int) -> bool:
    """Return whether a term corrects a listed weight: without it, all else scales as well."""
    term = found.fit.model.terms[index]
    return term.name == "gravity" and term.restated


def _beyond_tolerance(problem: Problem, test: Problem, found: Found) -> Found:
    """Return a search in which a freed datasheet value counts as seen if errors show it.

    Without it, the fit strains the datasheet for almost the same value; here it is compared with
    the best fit that leaves the value near the datasheet's.
    """
    worths, less = list(found.worths), list(found.less)
    for k, term in enumerate(found.fit.model.terms):
        if term.tight is None:
            continue
        near = kept_near(problem, found.fit, k, OUTSIDE)
        held = test.scored(near).cost - test.scored(found.fit).cost
        shown = replace(worth(problem, near, found.fit, term), held=held)
        if shown.enough and shown.seen and (shown.fall > worths[k].fall or not worths[k].seen):
            worths[k], less[k] = shown, near
    return replace(found, worths=tuple(worths), less=tuple(less))


def _deafer(problem: Problem, less: Fit, more: Fit) -> bool:
    """Return whether a fit responds so much less to its torque that it refutes nothing."""
    if not problem.force:
        return False
    one, other = (problem.deafness(fit.model, fit.z) for fit in (less, more))
    return one - other > DEAFER


def _polished(
    case: Case, problem: Problem, test: Problem, found: Found, joints: dict[str, Joint]
) -> Found:
    """Return a search refitted to predict best, with its inertia nearly unchanged.

    That of the datasheet is taken if it predicts better, held-out data included: slow motion does
    not tell an inertia, and the search then ends at a small one. Horizons at which it would be
    worse than datasheet or least squares get more weight.
    """
    problem = replace(problem)
    problem.force = 0.0
    limits = [relative(case.fit, case.fit.errors(joints[n])) for n in joints if n != "stages"]
    kept = [_with_inertia_kept(found.fit.model, found.fit.z, stated=s) for s in (True, False)]
    stated, fit = (problem.fit(*one) for one in kept)
    if stated.cost + test.scored(stated).cost < fit.cost + test.scored(fit).cost:
        fit = stated
    model = fit.model
    for _ in range(BALANCED):
        errors = dict(zip(case.fit.keys, fit.relative(), strict=True))
        worse = [any(errors[key] > limit[key] for limit in limits) for key in case.fit.keys]
        if not any(worse):
            break
        problem.weights = problem.weights * np.where(worse, 2.0, 1.0)
        problem.weights /= problem.weights.sum()
        fit = problem.fit(model, fit.z)
    return replace(found, fit=fit)


def _finer(case: Case, problem: Problem, found: Found) -> Found:
    """Return a search whose values come from more windows of the same pieces."""
    coarse, fine = replace(problem), Problem(case.fine, count=problem.count)
    coarse.force = fine.force = 0.0
    fit = fine.fit(found.fit.model, found.fit.z)
    return replace(found, fit=coarse.at(fit.model, fit.z))


def _with_inertia_kept(model: Model, z: Floats, *, stated: bool) -> tuple[Model, Floats]:
    """Return a model whose inertia is held near its current or stated value, and coordinates."""
    terms, z = [], z.copy()
    for k, (term, values) in enumerate(zip(model.terms, model.values(z), strict=True)):
        if term.name == "inertia":
            start = term.numbers[0].start if stated else values[0]
            number = replace(term.numbers[0], start=start, scale=KEPT)
            term = replace(term, numbers=(number,), loose=term.loose or term.numbers[0])
            z[model.span(k)] = 0.0
        terms.append(term)
    return replace(model, terms=tuple(terms)), z


def _settled(case: Case, joints: dict[str, Joint], best: str) -> Judgement:
    """Return the judgement with a joint as its answer."""
    errors = {name: case.test.errors(joint) for name, joint in joints.items()}
    table = {name: relative(case.test, e) for name, e in errors.items()}
    known = left_by(case.all, joints[best], past=True)
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
