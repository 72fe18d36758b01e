"""Which effects of an explanation are named, and their status, confidence and rivals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.diagnosis import EVEN_CHANCE, Interval, NamedEffect
from cjt_gym.gap.judged.confidence import confidence
from cjt_gym.gap.judged.confusable import best_rival, rival_fits
from cjt_gym.gap.judged.gap_size import harms
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.recorded.listed import in_place_of
from cjt_gym.gap.recorded.missing import same_here, undecided
from cjt_gym.gap.recorded.setting import Setting
from cjt_gym.gap.stages.explain import Explanation
from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.gap.stages.heldout import worth
from cjt_gym.gap.stages.intervals import (
    Covariance,
    at_an_end,
    effect_intervals,
    is_open,
    may_be_nothing,
)
from cjt_gym.gap.stages.lateness import may_be_the_records
from cjt_gym.gap.stages.leftover import status
from cjt_gym.gap.stages.merit import MARGIN, evidence
from cjt_gym.gap.stages.prune import SAME, Need, lowers, richer
from cjt_gym.gap.stages.sensing import SensorFinding
from cjt_gym.joint import EFFECTS

SHADOW = 0.25
"""Confidence below which an effect beside a cause outside the table is considered its shadow."""
LIKE_FRICTION = frozenset({"square_m", "square_l", "warm_up", "spot"})
"""Causes outside the table that a combination of friction effects imitates."""
OFF, UNEVEN = 2.5, 0.1
"""Usual deviations of an offset, and its share of a symmetric friction, from which the friction may
as well be asymmetric."""
MIRRORED = 1.5
"""Ratio of the friction in the two directions up to which both are nearly the same."""
STRAINED = 5.0
"""Tolerances by which a datasheet value may be off beside a stage that stays unexplained, or
nothing is confirmed: what is missing there may be missing elsewhere."""
JITTERED = 0.03
"""Deviation of the sampling times that a channel shows, in samples, above which it may scatter by
the clock: on two simulated logs whose clock jittered by 0.10 and 0.12 samples and whose noise was
as stated, the rest of it passed for 1.4 and 2.3 times that noise."""
SHAKEN = 0.3
"""Share of the noise found that this must cause: less is chance, as the slope of a noisy channel is
seen over few samples. On those logs it must have been 0.7 and 0.9 for the noise that was found."""
CLOCK = "it scatters with its slope, as if the sampling times jittered"
"""Doubt of the noise of such a channel."""


def name_effects(
    found: Explanation, spread: Covariance, unseen: Sequence[Setting]
) -> tuple[NamedEffect, ...]:
    """Return the effects of an explanation to be named, ordered by their share of the gap.

    Beside friction outside the table no effect of that stage is confirmed: it may be a remnant.

    Args:
        found: The explanation.
        spread: Covariance of its numbers.
        unseen: Records that it was not fitted to, if any.
    """
    problem, fit = found.problem, found.fit
    whole = _whole(found)
    clouded = {effect.stage for effect in fit.model.effects if effect.name in LIKE_FRICTION}
    strained = _is_strained(found)
    rows = []
    for index, (effect, need) in enumerate(zip(fit.model.effects, found.needs, strict=True)):
        if effect.outside:
            continue
        trial = worth(found.held, index)
        state = status(need, effect.touches, found.left, trial)
        if state is None:
            continue
        numbers = effect_intervals(problem, fit, index, spread)
        lead = evidence(problem, fit) - best_rival(found, index)
        lead = min(lead, need.evidence)
        doubt = _doubt(found, index, numbers, held_out_shows=state == "confirmed")
        if not doubt and _harmful(found, need, unseen):
            doubt = "unseen data are replayed better without it, if other values make up for it"
        if not doubt and lead < MARGIN:
            doubt = "another explanation is as good"
        chance = confidence(lead, trial, bool(doubt))
        beside = any(other.outside for other in fit.model.effects)
        if beside and chance < SHADOW and not undecided(problem.stages.setting, effect.name):
            continue
        alike = _confusable(found, index, numbers)
        guessed = any(_corrects_a_guess(problem.stages.setting, name) for name in alike)
        if not doubt and effect.stage in clouded:
            doubt = "friction that is not in the table is there as well"
        elif not doubt and guessed:
            doubt = "a guess of the datasheet may be wrong instead"
        elif not doubt and strained:
            doubt = "other values of the datasheet had to leave their tolerances beside it"
        elif not doubt and chance < EVEN_CHANCE:
            doubt = "its evidence is weak"
        rows.append(
            NamedEffect(
                effect.name,
                effect.stage,
                effect.body,
                effect.channel,
                numbers,
                "tentative" if doubt else "confirmed",
                chance,
                float(np.clip(need.evidence / whole, 0.0, 1.0)),
                alike,
                lead,
                None if trial is None else trial.worth,
                doubt,
            )
        )
    least = min((row.gap_removed for row in rows), default=1.0)  # noise moves no joint
    sensors = (_sensor_row(finding, problem.stages.setting) for finding in found.sensors)
    rows += [replace(row, gap_removed=min(row.gap_removed, least)) for row in sensors]
    return tuple(sorted(rows, key=lambda row: -row.gap_removed))


def doubted(effect: NamedEffect, why: str) -> NamedEffect:
    """Return an effect marked as tentative, unless it was read off a channel."""
    if effect.stage == "sensing" and effect.name in ("noise", "quantization"):
        return effect
    return effect.doubted(why)


def _doubt(
    found: Explanation, index: int, numbers: Mapping[str, Interval], *, held_out_shows: bool
) -> str:
    """Return why an effect is not confirmed for what it is, or nothing."""
    setting, effect = found.problem.stages.setting, found.fit.model.effects[index]
    doubts = (
        (not held_out_shows, "held-out data do not prove it"),
        (may_be_nothing(effect, numbers), _absent(setting, effect.name)),
        (at_an_end(effect, numbers), "its number is at the end of its range"),
        (is_open(effect, numbers), "its number may be ten times as large"),
        (undecided(setting, effect.name), "these channels do not tell it from another effect"),
        (
            may_be_the_records(effect.name, numbers, setting.series.dt),
            "the recording itself may be late by as much",
        ),
        (bool(_refining(found, index)), "a law that refines it lowers what is left"),
        (_warm(found, index, numbers), "the motor may have been warm from the start"),
        (_is_lopsided(found, index, numbers), "an offset beside it may be its asymmetry"),
    )
    return next((why for holds, why in doubts if holds), "")


def _absent(setting: Setting, name: str) -> str:
    """Return that an effect may be absent, with what the joint file lists in its place."""
    listed = [other for other in in_place_of(name) if other in setting.listed]
    if not listed:
        return "its interval includes its absence"
    return f"its interval includes its absence: there may be no {listed[0]}, though the file has it"


def _harmful(found: Explanation, need: Need, unseen: Sequence[Setting]) -> bool:
    """Return whether an effect worsens the replay of unseen data."""
    less, more = (written(found.problem, f.model, f.z) for f in (need.without, found.fit))
    return harms(unseen, less, more)


def _refining(found: Explanation, index: int) -> list[str]:
    """Return the laws that refine an effect and leave less, be it below the stated noise."""
    fits = richer(found.fit, found.seen, index)
    return [name for name, other in fits if lowers(other, found.fit) > SAME]


def _warm(found: Explanation, index: int, numbers: Mapping[str, Interval]) -> bool:
    """Return whether a small torque constant may be that of a motor that was warm from the start.

    Derating counts from the temperature at which a record begins, which no channel shows.
    """
    effects = found.fit.model.effects
    derates = any(effect.name == "thermal_derating" for effect in effects)
    nominal = found.problem.stages.setting.nominal["k_t"]
    small = "k_t" in numbers and numbers["k_t"].value < nominal
    return derates and effects[index].name == "torque_constant" and small


def _is_lopsided(found: Explanation, index: int, numbers: Mapping[str, Interval]) -> bool:
    """Return whether symmetric friction may as well be asymmetric.

    An offset that was fitted beside it may be its asymmetry, and so may what was taken for the
    inaccuracy of a drive whose current is not measured.
    """
    problem, fit = found.problem, found.fit
    effect = fit.model.effects[index]
    if effect.name != "coulomb":
        return False
    level = max(one.value for one in numbers.values())
    fields = problem.fields(fit.model, fit.z)
    torque = {"i_0": fields["k_t"] * fields["n"] * fields["i_0"], "tau_0": fields["tau_0"]}
    offset = any(
        abs(z) > OFF and abs(torque[nuisance.field]) > UNEVEN * level
        for nuisance, z in zip(problem.shared, fit.z, strict=False)
        if nuisance.field in torque
    )
    if offset or not problem.stages.setting.current_unspecified:
        return offset
    beside = [k for k, e in enumerate(fit.model.effects) if e.name == "torque_offset"]
    values = [x for k in beside for x in problem.values(fit.model, fit.z, k).values()]
    if any(abs(x) > UNEVEN * level for x in values):
        return True
    return any(_is_uneven(problem, fit, other, effect.body) for other in found.seen)


def _is_uneven(problem: Problem, named: Fit, fit: Fit, body: str | None) -> bool:
    """Return whether the named effects with asymmetric friction in one body are indeed uneven."""
    others = {e.name for e in fit.model.effects} - {"coulomb_asym"}
    if not others <= {e.name for e in named.model.effects} - {"coulomb", "torque_offset"}:
        return False
    for index, effect in enumerate(fit.model.effects):
        if effect.name == "coulomb_asym" and effect.body == body:
            levels = problem.values(fit.model, fit.z, index).values()
            return max(levels) > MIRRORED * min(levels)
    return False


def _corrects_a_guess(setting: Setting, name: str) -> bool:
    """Return whether an effect would only correct what the datasheet guesses."""
    known = setting.joint.parameters.quantities
    return any(p.symbol in known and known[p.symbol].guess for p in EFFECTS[name].parameters)


def _is_strained(found: Explanation) -> bool:
    """Return whether a stage stays unexplained although a value of the datasheet gave way to it."""
    left = {item.stage for item in found.left}
    released = {effect.releases for effect in found.fit.model.effects}
    return any(
        abs(z) > STRAINED and left & set(nuisance.stages)
        for nuisance, z in zip(found.problem.shared, found.fit.z, strict=False)
        if nuisance.unknown.log and nuisance.unknown.prior and nuisance.field not in released
    )


def _confusable(found: Explanation, index: int, numbers: Mapping[str, Interval]) -> tuple[str, ...]:
    """Return effects that could replace an effect in this explanation or with these channels."""
    names = rival_fits(found, index)
    name = found.fit.model.effects[index].name
    warmth = ("thermal_derating",) if _warm(found, index, numbers) else ()
    same = same_here(found.problem.stages.setting, name)
    uneven = ("coulomb_asym",) if _is_lopsided(found, index, numbers) else ()
    laws = _refining(found, index)
    return tuple(dict.fromkeys((*warmth, *uneven, *laws, *names, *same)))


def _whole(found: Explanation) -> float:
    """Return the evidence that the joint without effects lacks, of which each effect has a share.

    The gap is measured in evidence, which counts residuals and strained datasheet values alike,
    under the predictors of the joint that was found.
    """
    problem, needs = found.problem, found.needs
    bare = needs[0].without if len(needs) == 1 else problem.fit(found.base.model, found.base.z)
    gained = evidence(problem, found.fit) - evidence(problem, bare)
    return max(gained, -evidence(problem, bare), *(need.evidence for need in needs), 1e-9)


def _sensor_row(finding: SensorFinding, setting: Setting) -> NamedEffect:
    unit = setting.joint.sensors[finding.channel]
    symbol = next(iter(unit.values())).unit
    key = "resolution" if finding.name == "quantization" else "noise"
    value = Interval(finding.value, finding.low, finding.high, symbol)
    effect = NamedEffect(
        finding.name,
        "sensing",
        None,
        finding.channel,
        {key: value},
        "confirmed",
        0.95,
        1.0 - 1.0 / finding.factor,
    )
    jitter = setting.noise[finding.channel].jitter
    moved = jitter * float(np.sqrt(np.mean(setting.series.speed(finding.channel) ** 2)))
    jittered = jitter > JITTERED * setting.series.dt and moved > SHAKEN * finding.value
    return effect.doubted(CLOCK) if jittered and finding.name == "noise" else effect
