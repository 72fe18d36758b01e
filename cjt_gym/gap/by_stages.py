"""The diagnosis of the stages: what they found, put to the test of a replay and told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.candidates.nuisances import FRICTION, WEIGHT
from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    TOO_FAR_OFF,
    Diagnosis,
    NamedEffect,
    StageGap,
    Suggestion,
    Unexplained,
    told_symbols,
)
from cjt_gym.gap.digits import plain
from cjt_gym.gap.evidence import Source
from cjt_gym.gap.horizons.findings.answer import title_of
from cjt_gym.gap.horizons.prediction.model import MEASURES
from cjt_gym.gap.identified import identified_joint, rounded, told_by
from cjt_gym.gap.judged.gap_size import HARM, measure_gap
from cjt_gym.gap.judged.naming import doubted, name_effects
from cjt_gym.gap.judged.refine import settled
from cjt_gym.gap.judged.replay import Written, steps, written
from cjt_gym.gap.judged.together import together, with_scale_of_torques
from cjt_gym.gap.next_record.suggest import cautious, suggest
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.missing import not_judged
from cjt_gym.gap.recorded.series import ENOUGH, Stretch
from cjt_gym.gap.recorded.setting import Setting, as_noisy, make_setting
from cjt_gym.gap.recorded.spring_damping import SYMBOL
from cjt_gym.gap.recorded.tolerances import common_deviation
from cjt_gym.gap.report.gather import gather, nothing_said, source_of
from cjt_gym.gap.report.localize import where
from cjt_gym.gap.stages.explain import Explanation, explain
from cjt_gym.gap.stages.fit import Fit, Model, Problem
from cjt_gym.gap.stages.intervals import Covariance, covariance
from cjt_gym.gap.stages.lateness import open_instant
from cjt_gym.gap.stages.leftover import Leftover, out_of_sight, untouched, verdict
from cjt_gym.gap.stages.select import BEYOND, Progress
from cjt_gym.joint import JointFile
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.structures import Structure
from cjt_gym.records import Record

TAIL = 0.2
"""Final share of a record that is held out for the replay if there is no second record."""
WITHIN = 2.5
"""Number of standard deviations of a datasheet value that count as its tolerance."""
FAR = 3.0
"""Residual within tolerances, as a multiple of noise, above which there is a gap."""
BOTH_ENDS = "Record torque and angles at both ends of the spring: tau, q_m and q_l."
BESIDE_SPRING = ("transmission", "sensing", "load")
"""Stages of which no effect is confirmed where spring and load cannot be told apart."""
KNOWN = 0.7
"""Share of the tolerance within which a fit must determine a datasheet value to refine it."""
MOVED = 0.1
"""Share of the tolerance by which a fit may move it instead; some are only known jointly."""
COMMANDING = ("i", "i_cmd", "tau_m", "tau_cmd")
"""Channels of which the stages need at least one."""

Ask = Callable[[], Suggestion]
"""Function that suggests what to record next; slower than most of a diagnosis."""


class Staged(NamedTuple):
    """The diagnosis of the stages.

    Attributes:
        diagnosis: The diagnosis.
        ask: Suggests the next record; None if the stages can tell nothing.
    """

    diagnosis: Diagnosis
    ask: Ask | None


def by_stages(
    whole: Sequence[Stretch],
    held: Sequence[Stretch],
    file: JointFile,
    shape: Structure,
    progress: Progress,
    *,
    turnable: bool,
) -> Staged:
    """Return the diagnosis of the stages' one-step predictors.

    Args:
        whole: Stretches of the records to explain.
        held: Stretches of records on which the explanation is tested; the last part of each other
            one if there are none.
        file: The nominal joint.
        shape: Structure of the joint.
        progress: Called with a description of the current step.
        turnable: Whether they are two records of equal rank, so that what is tested may turn out to
            be what is explained.
    """
    cuts = [int((1.0 - TAIL) * len(one)) for one in whole]
    fitted = whole if held else [one.slice(0, cut) for one, cut in zip(whole, cuts, strict=True)]
    tested = held or [one.slice(cut, None) for one, cut in zip(whole, cuts, strict=True)]
    tested = _long(tested)
    try:
        return _diagnosed(fitted, tested, turnable, file, shape, progress)
    except (np.linalg.LinAlgError, FloatingPointError, ValueError) as error:
        if isinstance(error, CjtGymError) and not _by_voltage(whole[0].record):
            raise
        why = str(error)
        return Staged(nothing_said(file, shape, _records(fitted), _records(tested), why), None)


def _diagnosed(
    fitted: Sequence[Stretch],
    tested: Sequence[Stretch],
    turnable: bool,
    file: JointFile,
    shape: Structure,
    progress: Progress,
) -> Staged:
    explanation, replayed = _explained(fitted, tested, file, shape, progress)
    if turnable and tested and _seen_elsewhere(explanation):
        progress("explaining the other record, which alone shows a gap")
        turned, others = _explained(tested, _long(fitted), file, shape, progress)
        if turned.fit.model.effects or not turned.left:
            explanation, replayed = turned, others
            fitted, tested = tested, _long(fitted)
    progress("replaying what was kept from the fit")
    known = explanation.problem.stages.setting
    replayed = [as_noisy(one, known) for one in replayed]
    source = source_of(file, shape, _records(fitted), _records(tested))
    title = title_of(*_records(fitted))
    return Staged(*_report(explanation, replayed or [known], bool(replayed), source, title))


def _explained(
    fitted: Sequence[Stretch],
    tested: Sequence[Stretch],
    file: JointFile,
    shape: Structure,
    progress: Progress,
) -> tuple[Explanation, list[Setting]]:
    """Return the explanation of records, and the records on which it is tested."""

    def setting_of(one: Stretch, zero: Mapping[str, float] | None) -> Setting:
        return make_setting(one.record, file, shape, zero, one.log)

    setting = setting_of(fitted[0], None)
    zero = setting.series.zero
    more = [setting_of(one, zero) for one in fitted[1:]]
    replayed = [setting_of(one, zero) for one in tested]
    return explain(setting, replayed, more, progress), replayed


def _records(found: Sequence[Stretch]) -> list[Record]:
    return [one.record for one in found]


def _by_voltage(record: Record) -> bool:
    """Return whether a joint is driven by a voltage alone, which the stages do not model."""
    return "v" in record and not any(name in record for name in COMMANDING)


def _seen_elsewhere(found: Explanation) -> bool:
    """Return whether only the held-out record shows a gap."""
    small = all(ms < BEYOND**2 for ms in found.base.mean_square.values())
    return bool(found.left) and not found.fit.model.effects and small


def _long(found: Sequence[Stretch]) -> list[Stretch]:
    return [one for one in found if len(one) >= ENOUGH]


def _report(
    found: Explanation,
    settings: Sequence[Setting],
    held_out: bool,
    source: Source,
    record: str,
) -> tuple[Diagnosis, Ask]:
    problem = found.problem
    spread = covariance(problem, found.fit)
    setting = problem.stages.setting
    named = name_effects(found, spread, settings if held_out else ())
    common = common_deviation(
        setting.joint, cut=setting.cut is Cut.BY_TORQUE, but=told_symbols(named)
    )
    named = tuple(with_scale_of_torques(effect, common) for effect in named)
    within = _within_tolerance(found)
    all_before = {n: problem.stages.residual(n, within.fields) for n in problem.stages.names}
    before = problem.stages.first(all_before)
    # Without named effects there is no explanation: the nominal joint stays, with its values
    # refined within their tolerances if that leaves no gap.
    explains = bool(named)
    if not explains and not found.left:
        found = replace(found, left=_beyond_tolerance(found, problem.mean_square(all_before)))
    refined = explains or not found.left
    fit = found.fit if explains else found.base
    if refined:
        fit = settled(problem, fit, spread if explains else covariance(problem, fit))
    nominal = Written(_nominal_fields(problem, found.base.z), setting.joint)
    told = _refined(found, fit, spread) if refined else {}
    shown = [effect for effect in named if effect.name not in MEASURES]
    models = steps(problem, fit, nominal, shown, told, record) if refined else [nominal]
    gap, rungs, replays = measure_gap(settings, models, held_out, shown)
    if not explains and gap.removed < 0.0:
        told, models = {}, [nominal]
        gap, rungs, replays = measure_gap(settings, models, held_out)
    if gap.high < -HARM:  # whatever each is worth, together they do harm
        why = "the named effects together make the replay worse"
        named = tuple(doubted(effect, why) for effect in named)
    left = found.left if explains else untouched(found.left)
    hidden = () if left else out_of_sight(setting, problem.stages.names, gap)
    if hidden:
        why = "nothing tells the spring from the load"
        named = tuple(doubted(e, why) if e.stage in BESIDE_SPRING else e for e in named)
    left = left or hidden
    stages = _stages(found, fit, all_before, named)
    drawn = gather(problem, fit, within, before["motor"])
    missing = not_judged(setting)
    said = (*missing, *open_instant(named, setting.series.dt))
    lying = where(setting, stages, before, problem.stages.first(fit.residuals))
    drawn = replace(
        drawn, regimes=lying, source=source, ladder=rungs, replays=replays,
        replay_dt=settings[-1].series.dt,
    )  # fmt: skip

    def ask() -> Suggestion:
        if hidden:
            return Suggestion(BOTH_ENDS)
        said = suggest(found, named, left)
        return cautious(said, problem.stages, held_out)

    fields = problem.fields(fit.model, fit.z)
    joint = identified_joint(setting, fields, named, told, record)
    if explains:
        joint = replace(joint, found=together(problem, fit, spread, joint, named, told))
    diagnosis = Diagnosis(
        verdict=verdict(len(named), left),
        stages=stages,
        regimes=next(iter(lying.values()))[0],
        effects=told_by(setting, fields, named),
        gap=gap,
        unexplained=_unexplained(left, said, missing, replayed=bool(hidden)),
        suggestion=Suggestion(""),
        seconds=0.0,
        evidence=drawn,
        joint=joint,
    )
    return diagnosis, ask


def _refined(found: Explanation, fit: Fit, spread: Covariance) -> dict[str, tuple[float, float]]:
    """Return the datasheet values the record determines, each with its relative deviation."""
    shared = found.problem.shared
    known = found.problem.stages.setting.joint.parameters.quantities
    released = {effect.releases for effect in fit.model.effects}
    fields = found.problem.fields(fit.model, fit.z)
    told = {}
    for k, n in enumerate(shared):
        deviation = spread.std(k)
        given = n.field in (*known, *FRICTION, *WEIGHT, "lag") and n.field not in released
        if given and n.unknown.log and (deviation < KNOWN or abs(fit.z[k]) > MOVED):
            for field in (n.field, *n.along):
                told[field] = (rounded(fields[field]), rounded(n.unknown.scale * deviation))
        if n.field == SYMBOL and not n.unknown.log:
            value = rounded(fields[SYMBOL])
            told[SYMBOL] = (value, rounded(n.unknown.scale * deviation / value) if value else 0.0)
    return told


def _within_tolerance(found: Explanation) -> Written:
    """Return the nominal joint with its values limited to their tolerances."""
    problem = found.problem
    known = {*problem.stages.setting.joint.parameters.quantities, *FRICTION, *WEIGHT}
    known |= {"tau_0", "i_0"}
    limited = [n.field in known for n in problem.shared]
    z = found.base.z.copy()
    z[limited] = np.clip(z[limited], -WITHIN, WITHIN)
    return written(problem, Model(), z)


def _beyond_tolerance(found: Explanation, mean_square: Mapping[str, float]) -> tuple[Leftover, ...]:
    """Return the stages explained only by values beyond their tolerances, worst first."""
    far = [(ms, name) for name, ms in mean_square.items() if ms > FAR**2]
    problem, nominal = found.problem, found.problem.stages.setting.nominal
    known = problem.stages.setting.joint.parameters.quantities
    values = problem.fields(Model(), found.base.z)
    off = ", ".join(
        f"{n.field} = {plain(values[n.field])} for {plain(nominal[n.field])} {known[n.field].unit}"
        for n, z in zip(problem.shared, found.base.z, strict=True)
        if n.field in known and abs(z) > WITHIN
    )
    text = f"{TOO_FAR_OFF} ({off})" if off else TOO_FAR_OFF
    return tuple(Leftover(name, 1.0, text) for _, name in sorted(far, reverse=True))


def _nominal_fields(problem: Problem, z: Floats) -> Fields:
    """Return the fields of the nominal joint with only a fit's offsets of the record added."""
    offsets = ("q_0", "w_i")
    pairs = zip(problem.shared, z, strict=False)
    z = np.array([value if nuisance.field in offsets else 0.0 for nuisance, value in pairs])
    return problem.fields(Model(), z)


def _stages(
    found: Explanation, fit: Fit, before: dict[str, np.ndarray], named: Sequence[NamedEffect]
) -> dict[str, StageGap]:
    problem = found.problem
    ms = problem.mean_square(before)
    blamed = {effect.stage for effect in named} | {item.stage for item in found.left}
    nominal = _nominal_fields(problem, fit.z)
    stated = problem.mean_square({n: problem.stages.residual(n, nominal) for n in ms})
    out: dict[str, StageGap] = {}
    for name in ("drive", "motor", "transmission", "load"):
        after = fit.mean_square[name] ** 0.5 if name in ms else 0.0
        if name in ms and name not in blamed:  # strained for the sake of another
            ms[name] = min(ms[name], stated[name])
        out[name] = StageGap(ms.get(name, 0.0) ** 0.5, after, name in blamed)
    factor = max([finding.factor for finding in found.sensors], default=1.0)
    out["sensing"] = StageGap(factor, 1.0, "sensing" in blamed)
    return out


def _unexplained(
    left: Sequence[Leftover],
    open_ends: Sequence[str],
    missing: tuple[str, ...],
    *,
    replayed: bool,
) -> Unexplained:
    if not left:
        return Unexplained(0.0, None, " ".join((NOTHING_LEFT, *open_ends)), missing=missing)
    worst = left[0]
    like = f" It looks like {worst.text}." if worst.text else ""
    place = "a replay" if replayed else f"the {worst.stage} stage"
    text = (
        f"In {place} {100 * worst.share:.0f} % of the gap is left. "
        f"No effect of the table explains it.{like}"
    )
    said = " ".join((text, *open_ends))
    return Unexplained(worst.share, worst.stage, said, missing=missing)
