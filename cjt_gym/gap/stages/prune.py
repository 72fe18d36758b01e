"""Revision of a selected model: leave one out, and the simplest or likeliest of equivalent laws."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.gap.recorded.missing import twins
from cjt_gym.gap.stages.fit import FLOOR, MOVES, Fit, Model, Problem, retuned, without
from cjt_gym.gap.stages.merit import LOG_SHARE, MARGIN, STRAIN, evidence
from cjt_gym.gap.stages.periodic import periodic_starts
from cjt_gym.gap.stages.select import compatible

FREQUENCY_MOVES = 6
"""Steps of a fit from another frequency."""
COARSE_STRAIN = 24.0
"""`STRAIN` if a channel is coarse, as rounding errors are not white noise."""
SAME = 0.03
"""Log reduction of a residual by which a more complicated law must do better."""
NEAR = 25.0
"""Difference in evidence within which two explanations are equally good."""
THOROUGH_MOVES, THOROUGH = 40, 1e-3
"""Steps of a fit that must end in the very minimum, and the gain of one at which it ends."""
FEW_MOVES, HOPELESS = 4, 150.0
"""Steps of a first fit of an alternative, and the lack of evidence at which it ends there."""
COLOURED = 0.25
"""Log reduction of a residual too small to separate two laws if no noise is specified."""
DEEP = 0.15
"""Log reduction of a residual below the stated noise from which the law that brings it is chosen:
where friction does not fall with speed, the law of falling friction brought none in simulation."""
BENEATH = ("coulomb", "damping", "cogging", "gear_ripple")
"""Effects that are sought below the stated noise: plain friction, of which hardly any body has only
one law, and waves over the angle, which nothing else makes."""
NOTHING = 1e-6
"""Mean square of a residual that is none, as that of a simulated drive, but for rounding."""
SLACK = 10.0
"""Evidence by which a simpler law may be worse."""
SIMPLER: Mapping[str, tuple[str, ...]] = {
    "coulomb": ("coulomb",),  # the smooth one: the plain one is the first of that name
    "stribeck": ("coulomb", "load_coulomb"),
    "presliding": ("coulomb", "load_coulomb"),
    "coulomb_asym": ("coulomb", "load_coulomb"),
    "load_friction": (),
    "viscous_asym": ("damping",),
}

EVEN: Mapping[str, str] = {"coulomb_asym": "coulomb", "viscous_asym": "damping"}


@dataclass(frozen=True)
class Need:
    """What a model loses without one of its effects."""

    evidence: float
    log_share: float  # largest log increase of a stage's residual
    stage: str  # that stage
    strain: float  # increase of the priors' cost
    without: Fit

    def material(self, strain: float) -> bool:
        """Whether the effect is large enough to be named."""
        return self.evidence > MARGIN and (self.log_share > LOG_SHARE or self.strain > strain)


def need(problem: Problem, fit: Fit, index: int) -> Need:
    """Return what a model loses without one of its effects."""
    less = without(problem, fit, index)
    least = {n: min(problem.floor(n), 1.0) for n in fit.mean_square}
    shares = {
        n: 0.5 * float(np.log(max(less.mean_square[n], least[n]) / max(ms, least[n])))
        for n, ms in fit.mean_square.items()
    }
    stage = max(shares, key=lambda n: shares[n])
    strain = problem.strain(less.z) - problem.strain(fit.z)
    return Need(loss(problem, less, fit), shares[stage], stage, strain, less)


def prune(problem: Problem, fit: Fit, strain: float = STRAIN) -> tuple[Fit, list[Need]]:
    """Return the model without the effects it does not need, and the need of the others.

    An effect is also material if it relieves the datasheet's priors by at least `strain`.
    """
    while fit.model.effects:
        needs = side_by_side(partial(need, problem, fit), range(len(fit.model.effects)))
        material = [n.material(strain) for n in needs]
        weakest = min(range(len(needs)), key=lambda k: (material[k], needs[k].evidence))
        if material[weakest]:
            return fit, needs
        fit = retuned(problem, needs[weakest].without)
    return fit, []


def simplify(problem: Problem, fit: Fit, candidates: tuple[Candidate, ...]) -> Fit:
    """Return the model with simpler laws of friction if they do as well."""
    for index, effect in enumerate(fit.model.effects):
        for name in SIMPLER.get(effect.name, ()):
            match = [h for h in candidates if h.name == name and h.body == effect.body]
            if match and not any(h.key == match[0].key for h in fit.model.effects):
                trials = (
                    replaced(problem, fit, index, match[0]) for replaced in (_swapped, _in_place)
                )
                trial = max(trials, key=lambda one: evidence(problem, one))
                if _as_good(problem, trial, fit) and loss(problem, trial, fit) < SLACK:
                    return simplify(problem, trial, candidates)
    return fit


def enrich(problem: Problem, fit: Fit, seen: Sequence[Fit], candidates: Sequence[Candidate]) -> Fit:
    """Return the model with another law if that lowers a residual far below the noise.

    This is a richer law of friction or another one of the drive, or one more effect. Noise that was
    stated, or allowed for, too large hides this from the evidence, which has it as its floor.
    """
    for index in range(len(fit.model.effects)):
        for other in (*(one for _, one in richer(fit, seen, index)), *_driven(fit, seen, index)):
            trial = problem.fit(other.model, other.z)
            if lowers(trial, fit) > DEEP:
                return trial
    return _with_more(problem, fit, candidates)


def _with_more(problem: Problem, fit: Fit, candidates: Sequence[Candidate]) -> Fit:
    """Return the model with each effect more that lowers a residual far below the noise.

    What they leave is the noise from then on.
    """
    may = [
        h
        for h in candidates
        if h.name in BENEATH
        and not h.variant
        and h.key not in {e.key for e in fit.model.effects}
        and compatible(fit.model, h)
        and any(fit.mean_square.get(n, np.inf) < FLOOR**2 for n in h.touches)
    ]
    begun = [replace(h, starts=(start,)) for h in may for start in _starts(problem, fit, h)]
    # a wave explains nothing before its frequency is right
    rough = [_with(problem, fit, h, moves=MOVES if h.search else FEW_MOVES) for h in begun]
    best = max(rough, key=lambda one: lowers(one, fit), default=fit)
    if lowers(best, fit) <= DEEP:
        return fit
    best = problem.fit(best.model, best.z)
    last, index = best.model.effects[-1], len(best.model.effects) - 1
    laws = [h for h in candidates if last.name in SIMPLER.get(h.name, ()) and h.body == last.body]
    tried = [_in_place(problem, best, index, law) for law in laws if law.name != last.name]
    finer = max(tried, key=lambda one: lowers(one, best), default=best)
    best = finer if lowers(finer, best) > DEEP else best
    problem.floors |= {n: ms for n, ms in best.mean_square.items() if ms < problem.floor(n)}
    return _with_more(problem, best, candidates)


def _starts(problem: Problem, fit: Fit, effect: Candidate) -> tuple[tuple[float, ...], ...]:
    """Return numbers of an effect from which it is fitted beside others: of a wave, several."""
    if effect.search is None:
        return effect.starts[:1]
    residual = problem.stages.first(fit.residuals)["motor"]
    fields = problem.fields(fit.model, fit.z)
    return periodic_starts(problem.stages, fields, residual, effect.search)


def _driven(fit: Fit, seen: Sequence[Fit], index: int) -> Iterator[Fit]:
    """Yield the fits with another law of the drive in the place of one, best first."""
    effect = fit.model.effects[index]
    rest = {e.key for e in fit.model.effects} - {effect.key}
    for other in sorted(seen, key=lambda one: one.cost):
        new = [e for e in other.model.effects if e.key not in rest]
        alike = len(new) == 1 and len(other.model.effects) == len(fit.model.effects)
        if alike and effect.family == new[0].family == "drive" and effect.name != new[0].name:
            yield other


def richer(fit: Fit, seen: Sequence[Fit], index: int) -> Iterator[tuple[str, Fit]]:
    """Yield the fits with a law that contains an effect of a fit in its place, with its name."""
    effect = fit.model.effects[index]
    rest = {e.key for e in fit.model.effects} - {effect.key}
    for other in seen:
        new = [e for e in other.model.effects if e.key not in rest]
        if len(new) == 1 and len(other.model.effects) == len(fit.model.effects):
            contains = effect.name in SIMPLER.get(new[0].name, ()) and new[0].name != effect.name
            if contains and new[0].body == effect.body:
                yield new[0].name, other


def lowers(one: Fit, other: Fit) -> float:
    """Return the largest log reduction of a residual by the first fit, 0 if it raises another."""
    falls = [
        0.5 * np.log(max(ms, NOTHING) / max(one.mean_square[n], NOTHING))
        for n, ms in other.mean_square.items()
    ]
    return float(max(falls)) if min(falls) > -SAME else 0.0


def alternatives(
    problem: Problem, fit: Fit, index: int, candidates: tuple[Candidate, ...]
) -> list[Fit]:
    """Return equally good fits that replace one effect by another of the same kind."""
    effect = fit.model.effects[index]
    there = {e.key for e in fit.model.effects}
    kin = [
        h
        for h in candidates
        if h.key not in there
        and h.stage == effect.stage
        and h.body == effect.body
        and (h.family == effect.family or effect.stage == "drive")
        and not h.search
    ]
    less = without(problem, fit, index) if kin else fit
    trials = []
    for h in kin:
        starts = range(len(h.starts))
        rough = max(
            (_with(problem, less, h, start=k, moves=FEW_MOVES) for k in starts),
            key=lambda one: evidence(problem, one),
        )
        if loss(problem, rough, fit) < HOPELESS:
            trials.append(problem.fit(rough.model, rough.z, known=rough.jacobian))
    return [trial for trial in trials if loss(problem, trial, fit) < NEAR]


def likelier_twins(problem: Problem, fit: Fit, candidates: tuple[Candidate, ...]) -> Fit:
    """Return the model with the likelier of the effects that this record cannot tell apart."""
    for likelier, twin in twins(problem.stages.setting):
        for index, effect in enumerate(fit.model.effects):
            other = [h for h in candidates if h.name == likelier]
            if effect.name == twin and other:
                trial = _swapped(problem, fit, index, other[0])
                fit = trial if loss(problem, trial, fit) < NEAR else fit
    return fit


def freed(problem: Problem, fit: Fit, seen: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
    """Return the best model of those that set another datasheet value free, and all of them.

    What they predict hardly differs: what tells them apart is how far the rest of the datasheet has
    to give way, which each of them must have settled.
    """
    tried: list[Fit] = []
    for index, effect in enumerate(fit.model.effects):
        if effect.releases is None:
            continue
        rest = {e.key for k, e in enumerate(fit.model.effects) if k != index}
        others: dict[Hashable, Fit] = {}
        for other in sorted(seen, key=lambda f: -evidence(problem, f)):
            new = [e for e in other.model.effects if e.key not in rest]
            same = len(other.model.effects) == len(fit.model.effects)
            if same and len(new) == 1 and new[0].releases is not None:
                others.setdefault(new[0].key, other)
        near = [other for other in others.values() if loss(problem, other, fit) < NEAR]
        tried += [problem.from_datasheet(f, THOROUGH_MOVES, THOROUGH) for f in near]
    return max([fit, *tried], key=lambda f: evidence(problem, f)), tried


def split_asymmetry(problem: Problem, fit: Fit, candidates: tuple[Candidate, ...]) -> Fit:
    """Return the model with a symmetric law plus an offset for an asymmetric one, if as good.

    While a body moves, unequal Coulomb levels equal symmetric ones plus a constant torque. If the
    accuracy of the command is unknown, an amplifier offset is the likelier of the two, even if it
    leaves a slightly larger residual: the colour of such a residual matters more.
    """
    for index, effect in enumerate(fit.model.effects):
        even = EVEN.get(effect.name)
        pair = [
            h
            for h in candidates
            if (h.name == even and h.body == effect.body and not h.variant)
            or h.name == "torque_offset"
        ]
        fresh = [h for h in pair if h.key not in {e.key for e in fit.model.effects}]
        if even is not None and any(h.name == even for h in fresh):
            trial = _swapped(problem, fit, index, *fresh)
            if loss(problem, trial, fit) < NEAR or _as_good(problem, trial, fit, COLOURED):
                return split_asymmetry(problem, trial, candidates)
    return fit


def uneven(problem: Problem, fit: Fit, candidates: tuple[Candidate, ...]) -> list[Fit]:
    """Return the fits with an asymmetric law in place of a symmetric one and an offset, if any.

    They are the alternatives that the record leaves open if `split_asymmetry` has decided.
    """
    offset = [k for k, e in enumerate(fit.model.effects) if e.name == "torque_offset"]
    found = []
    for effect in fit.model.effects:
        law = next((name for name, even in EVEN.items() if even == effect.name), None)
        other = [h for h in candidates if h.name == law and h.body == effect.body]
        if other:
            bare = without(problem, fit, offset[0]) if offset else fit
            at = [e.key for e in bare.model.effects].index(effect.key)
            found.append(_swapped(problem, bare, at, other[0]))
    return found


def other_frequencies(problem: Problem, fit: Fit) -> Fit:
    """Return a fit with its periodic torques at the best of the prominent frequencies.

    A rough fit can mistake a neighbour for the true frequency if the noise is poorly known.
    """
    stages = problem.stages
    for index, effect in enumerate(fit.model.effects):
        if effect.search not in ("cog", "rip"):
            continue
        less = without(problem, fit, index)
        at = problem.span(fit.model, index).start
        size = float(np.hypot(*fit.z[at + 1 : at + 3]))
        residual = stages.first(less.residuals)["motor"]
        fields = problem.fields(less.model, less.z)
        for f, a, b in periodic_starts(stages, fields, residual, effect.search):
            z = fit.z.copy()
            z[at] = effect.unknowns[0].coordinate(f)
            z[at + 1 : at + 3] = size * np.array([a, b]) / max(float(np.hypot(a, b)), 1e-300)
            trial = problem.fit(fit.model, z, FREQUENCY_MOVES)
            fit = max(fit, trial, key=lambda one: evidence(problem, one))
    return fit


def _swapped(problem: Problem, fit: Fit, index: int, *effects: Candidate) -> Fit:
    """Return a fit with other effects in place of one of its own."""
    return _with(problem, without(problem, fit, index), *effects)


def _in_place(problem: Problem, fit: Fit, index: int, effect: Candidate) -> Fit:
    """Return a fit with another effect in place of one of its own, started from all it has found.

    Without any friction, damping and datasheet values may move too far to come back.
    """
    effects, own = fit.model.effects, problem.span(fit.model, index)
    known = problem.values(fit.model, fit.z, index)
    new = [
        u.coordinate(known.get(u.symbol, start))
        for u, start in zip(effect.unknowns, effect.starts[0], strict=True)
    ]
    z = np.concatenate([fit.z[: own.start], new, fit.z[own.stop :]])
    return problem.fit(Model((*effects[:index], effect, *effects[index + 1 :])), z)


def _with(
    problem: Problem, less: Fit, *effects: Candidate, start: int = 0, moves: int = MOVES
) -> Fit:
    """Return a fit with more effects, from one of their starting points."""
    first = [
        u.coordinate(x)
        for effect in effects
        for u, x in zip(effect.unknowns, effect.starts[start], strict=True)
    ]
    model = Model((*less.model.effects, *effects))
    return problem.fit(model, np.concatenate([less.z, first]), moves, known=less.jacobian)


def loss(problem: Problem, less: Fit, more: Fit) -> float:
    """Return the evidence that the first fit lacks compared with the second."""
    return evidence(problem, more) - evidence(problem, less)


def _as_good(problem: Problem, simple: Fit, full: Fit, share: float = SAME) -> bool:
    floors = {n: problem.floor(n) for n in simple.mean_square}
    return all(
        0.5 * np.log(max(ms, floors[n]) / max(full.mean_square[n], floors[n])) < share
        for n, ms in simple.mean_square.items()
    )
