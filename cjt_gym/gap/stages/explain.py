"""The explanation of records: which effects, how large, and what is left."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.candidates.candidate import Candidate
from cjt_gym.gap.candidates.table import all_candidates, shown
from cjt_gym.gap.recorded.setting import Setting, as_noisy
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Fit, Model, Problem, retuned
from cjt_gym.gap.stages.heldout import HeldOut, on_held_out, worth
from cjt_gym.gap.stages.lateness import DELAY, as_effect
from cjt_gym.gap.stages.leftover import HELD_LEFT, LEFT, Leftover, leftovers
from cjt_gym.gap.stages.merit import STRAIN
from cjt_gym.gap.stages.process import COLOUR, allow_for_colour, settle_noise
from cjt_gym.gap.stages.prune import (
    COARSE_STRAIN,
    THOROUGH,
    THOROUGH_MOVES,
    Need,
    alternatives,
    enrich,
    freed,
    likelier_twins,
    other_frequencies,
    prune,
    simplify,
    split_asymmetry,
    uneven,
)
from cjt_gym.gap.stages.select import (
    BEYOND,
    COARSE_BEYOND,
    Progress,
    Selection,
    silent,
)
from cjt_gym.gap.stages.sensing import SensorFinding, noisy_current, sensor_findings, with_findings
from cjt_gym.joint.kernel.arrays import Floats

PATIENCE = 25.0
"""Processor time after which the search for effects stops with its best result [s]."""
MUCH = 1.5
"""Ratio of the noise before to that after an explanation above which another is sought."""
HASTE = 15.0
"""Processor time of an explanation after which no second one is sought [s]."""
TRIED_LESS = 8.0
"""Ratio of the noise to that which is tried in its place."""
REFUTED = 0.2
"""Worth on held-out data below which an effect is refuted."""
CENTRE, SIDES = "centre_g", (-0.8, -0.4, 0.0, 0.4, 0.8)
"""Field of where a gear touches first within its play, and coordinates from which it is sought."""
BETTER = 0.7
"""Ratio of held-out mean squares below which an alternative model is preferred."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """The fitted explanation of one record."""

    problem: Problem
    base: Fit  # without effects
    fit: Fit  # with the needed effects
    needs: tuple[Need, ...]  # of each effect
    held: tuple[HeldOut, ...]  # performance on held-out records
    seen: tuple[Fit, ...]  # all other fits
    left: tuple[Leftover, ...]  # stages that are not explained
    sensors: tuple[SensorFinding, ...]  # channels that are worse than specified


def explain(
    setting: Setting,
    others: Sequence[Setting] = (),
    more: Sequence[Setting] = (),
    progress: Progress = silent,
) -> Explanation:
    """Return the explanation of a record, together with `more`, that holds on the `others`.

    Where no noise of the drive is stated, what the nominal joint leaves counts as noise at first.
    The explained joint may leave much less of it, or a joint that is explained for much less.
    """
    began = time.process_time()
    found = _explained(setting, others, more, progress)
    late = time.process_time() - began > HASTE
    if not setting.current_unspecified or late or not _is_explained(found):
        return found
    before, calm = found.problem.stages.setting.process, _calm(setting, found)
    less = before > MUCH * calm.process
    if less and not found.fit.model.effects:
        return found
    tried = calm if less else replace(calm, process=before / TRIED_LESS)
    other = _explained(tried, others, more, progress)
    as_calm = less or _calm(setting, other).process < MUCH * tried.process
    return other if as_calm and _is_explained(other) else found


def _is_explained(found: Explanation) -> bool:
    """Return whether the motor's residual is what noise may leave."""
    return found.fit.mean_square["motor"] < LEFT**2


def _calm(setting: Setting, found: Explanation) -> Setting:
    """Return a setting with the noise of the drive that an explained joint leaves."""
    problem = found.problem
    stages = Stages(replace(problem.stages.setting, process=0.0, allowance=1.0))
    settle_noise(stages, problem.fields(found.fit.model, found.fit.z))
    process, jitter = stages.setting.process, stages.setting.noise["q_m"].jitter
    noise = {**setting.noise, "q_m": replace(setting.noise["q_m"], jitter=jitter)}
    return replace(setting, noise=noise, process=process, allowance=COLOUR)


def _explained(
    setting: Setting, others: Sequence[Setting], more: Sequence[Setting], progress: Progress
) -> Explanation:
    progress("fitting the nominal joint within its tolerances")
    problem, base = without_effects(setting, more)
    sensors = sensor_findings(setting, base.residuals)
    if any(finding.name == "noise" for finding in sensors):
        problem, base = without_effects(with_findings(setting, sensors), more)
    until = time.process_time() + PATIENCE
    candidates = all_candidates(setting, problem.stages.names)
    coarse = any(finding.name == "quantization" for finding in sensors)
    if any(finding.name == "quantization" and finding.channel == "i" for finding in sensors):
        candidates = tuple(h for h in candidates if h.name != "command_quantization")
    # Causes outside the table leave small traces; only a stated noise tells them from colour.
    rows = () if setting.current_unspecified else problem.stages.outside.rows
    outside = shown(rows, problem.stages.names)
    beyond = COARSE_BEYOND if coarse else BEYOND
    selection = Selection(
        problem, candidates, base, outside, until=until, beyond=beyond, progress=progress
    )
    found = selection.run()
    fit = simplify(problem, found, selection.candidates)
    fit = enrich(problem, fit, selection.seen, selection.candidates)
    fit, tried = freed(problem, fit, selection.seen)
    selection.seen += tried
    if "tau" not in setting.series and fit.model.effects:
        # along the scale of all torques, which nothing but the datasheet tells
        fit = problem.from_datasheet(fit, THOROUGH_MOVES, THOROUGH)
    fit = likelier_twins(problem, fit, selection.candidates)
    if fit is not found:  # the other law started from the datasheet values that the first had left
        fit = retuned(problem, fit)
    if setting.current_unspecified:
        fit = other_frequencies(problem, fit)
        fit = split_asymmetry(problem, fit, selection.candidates)
        selection.seen.append(fit)
    late = _found_late(setting, fit, sensors)
    if late:
        sensors = (*sensors, *late)
        problem, base = without_effects(with_findings(setting, sensors), more)
        fit = retuned(problem, fit)
    progress("leaving out one effect after the other")
    tested = [with_findings(other, sensors) for other in others]
    strain = COARSE_STRAIN if coarse else STRAIN
    fit, needs, held = _standing(problem, fit, tested, strain)
    other = _decided(problem, fit, held, tested, selection.candidates)
    if other is not fit:
        fit, needs, held = _standing(problem, retuned(problem, other), tested, strain)
    seen = tuple(selection.seen)
    delayed = as_effect(problem, base, fit, seen, selection.candidates)
    if delayed is not None:
        standing = _standing(delayed.problem, delayed.fit, tested, strain)
        if any(effect.name == DELAY for effect in standing[0].model.effects):
            problem, base, seen = delayed.problem, delayed.base, delayed.seen
            fit, needs, held = standing
    left = leftovers(base, fit, needs, held, coarse)
    if setting.current_unspecified:
        seen = (*seen, *uneven(problem, fit, selection.candidates))
    return Explanation(problem, base, fit, tuple(needs), held, seen, left, sensors)


def _standing(
    problem: Problem, fit: Fit, others: Sequence[Setting], strain: float
) -> tuple[Fit, list[Need], tuple[HeldOut, ...]]:
    """Return the model without effects that are not needed or that held-out data refute."""
    while True:
        fit, needs = prune(problem, fit, strain)
        held = tuple(on_held_out(other, problem, fit) for other in others)
        trials = [worth(held, k) for k in range(len(needs))]
        refuted = [k for k, trial in enumerate(trials) if trial and trial.worth < REFUTED]
        if not refuted:
            return fit, needs, held
        worst = min(refuted, key=lambda k: needs[k].evidence)
        fit = retuned(problem, needs[worst].without)


def _decided(
    problem: Problem,
    fit: Fit,
    held: Sequence[HeldOut],
    others: Sequence[Setting],
    candidates: tuple[Candidate, ...],
) -> Fit:
    """Return the model that does best on held-out records, of those the first cannot tell apart.

    Held-out records are consulted only if the chosen model leaves a residual there.
    """
    stages = {n for h in held for n, ms in h.after.items() if ms > HELD_LEFT**2}
    best, least = fit, sum(sum(h.after.values()) for h in held)
    for index, effect in enumerate(fit.model.effects):
        if effect.outside or not stages & set(effect.touches):
            continue
        for trial in alternatives(problem, fit, index, candidates):
            left = sum(sum(on_held_out(o, problem, trial).after.values()) for o in others)
            if left < BETTER * least:
                best, least = trial, left
    return best


def _found_late(
    setting: Setting, fit: Fit, known: tuple[SensorFinding, ...]
) -> tuple[SensorFinding, ...]:
    """Return noisy channels that are visible only once the effects are removed."""
    found = list(sensor_findings(setting, fit.residuals))
    if "drive" in fit.residuals and (noisy := noisy_current(setting, fit.residuals["drive"])):
        found.append(noisy)
    channels = {finding.channel for finding in known}
    return tuple(f for f in found if f.name == "noise" and f.channel not in channels)


def _begun(problem: Problem) -> list[Floats]:
    """Return coordinates from which a fit starts: several where play may touch on either side."""
    found = [np.zeros(len(problem.shared))]
    for k, nuisance in enumerate(problem.shared):
        if nuisance.field == CENTRE:
            found = [np.where(np.arange(len(found[0])) == k, side, found[0]) for side in SIDES]
    return found


def without_effects(setting: Setting, more: Sequence[Setting]) -> tuple[Problem, Fit]:
    """Return the problem of one or more records, and its fit without any effect.

    Raises:
        FloatingPointError: A stage cannot be predicted one sample ahead.
    """
    others = tuple(Stages(as_noisy(one, setting)) for one in more)
    problem = Problem.of(Stages(setting, others=others))
    fits = [problem.fit(Model(), z) for z in _begun(problem)]
    base = retuned(problem, min(fits, key=lambda fit: fit.cost))
    if away := [n for n, ms in base.mean_square.items() if not np.isfinite(ms)]:
        raise FloatingPointError(
            f"one sample ahead the nominal {' and '.join(away)} stage runs away, as where it "
            "resonates above the log's Nyquist frequency"
        )
    if setting.current_unspecified and setting.allowance == 1.0:
        allow_for_colour(problem.stages, base.mean_square["motor"])
        base = retuned(problem, base)
    return problem, base
