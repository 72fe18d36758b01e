"""Conversion of a judgement to a diagnosis: effects, joint, verdict, gap."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cjt_gym.gap.candidates.separated import separating
from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    TOO_FAR_OFF,
    Diagnosis,
    Horizon,
    NamedEffect,
    StageGap,
    Suggestion,
)
from cjt_gym.gap.digits import plain
from cjt_gym.gap.horizons.findings.by_torque import (
    HELD,
    KEPT,
    RUNS_OUT,
    SET,
    agrees,
    beside_torque,
    told_by_torque,
    with_told,
)
from cjt_gym.gap.horizons.findings.corrected_values import (
    LATE,
    corrected,
    is_usual_offset,
    moving_together,
    refined,
)
from cjt_gym.gap.horizons.findings.found_joint import joint_of
from cjt_gym.gap.horizons.findings.naming import effects_of
from cjt_gym.gap.horizons.findings.not_confirmed import with_rivals
from cjt_gym.gap.horizons.findings.plotted import pictured
from cjt_gym.gap.horizons.findings.verdict import (
    gap_of,
    main_row,
    of_answer,
    stages_of,
    unexplained_of,
    verdict_of,
)
from cjt_gym.gap.horizons.fitting.datasheet import stated_tolerance
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.selection.judgement import LOUD, NEAR, Judgement
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.horizons.torque.inverse import seen_in_torque
from cjt_gym.gap.recorded.tolerances import OUTSIDE

BLIND = 0.99
"""Relative error from which a joint predicts no better than motion at constant speed."""
SHADOW = 0.25
"""Confidence below which an effect is attributed to a cause outside the table."""
ASTRAY, STILL = 20.0, 0.5
"""Residual of the load, in units of its noise and as a share of that before, above which nothing is
explained. On a torsion rig it was 3.6 after 10; with exchanged encoders 89 after 81, and 101 where
one angle was read four times too large."""
UNMOVED = (
    "One sample ahead the load's angle is off by {} times its noise, with these effects as "
    "without: look at the columns of both angles."
)
GONE = 0.05
"""Ratio to the datasheet's error below which a joint that leaves nothing explains what the stages
could not."""


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
    """Return a diagnosis with the answer of a judgement.

    Args:
        first: The diagnosis of the stages.
        judged: The judgement, whose answer is not the stages' joint.
        excluded: Effects that the record cannot identify, with the reason.
        record: Name of the record, for the joint's sources.
    """
    seen = seen_in_torque(judged.case.joint, judged.case.logs, excluded)
    seen = {n: one for n, one in seen.items() if not is_usual_offset(judged, n, one.values[0])}
    effects = without_late_drive(effects_of(judged, excluded, seen), first.stages["drive"])
    effects = _as_staged(effects, first.effects)
    regressed, loud = judged.answer == "least squares", main_row(judged).found > LOUD
    if judged.answer == "datasheet" and not loud:
        refuted = {} if judged.found is None else judged.found.refuted
        seen = {name: one for name, one in seen.items() if name in refuted}
    if loud:  # little predicts the motion: the torque is the better evidence, or the only one
        blind = main_row(judged).found > BLIND
        effects = () if blind else beside_torque(judged, seen, effects)
    if not (regressed or loud):
        seen = _beside(judged, seen)
    by_torque = told_by_torque(judged, seen, effects, excluded, alone=regressed or loud)
    held = by_torque and loud and not regressed
    told_in = KEPT
    if held and (with_them := with_told(judged, by_torque)) is not judged:
        judged, told_in = with_them, SET
    effects = tuple(sorted((*effects, *by_torque), key=lambda e: -e.gap_removed))
    effects = tuple(with_rivals(effects, excluded))
    # If the stages find no cause in the table, it is not there, unless it is a datasheet value, or
    # one that they cannot see for want of a channel.
    told = TOO_FAR_OFF in first.unexplained.text and not judged.unexplained
    staged = bool(first.evidence.regimes)
    main = main_row(judged)
    gone = judged.exhausted and main.found < GONE * main.datasheet
    gone = gone and first.unexplained.stage != "drive"  # of which predictions of motion tell little
    beaten = first.verdict == "partly_explained" and judged.answer in ("datasheet", "least squares")
    missed = (first.verdict == "unexplained" or beaten) and not (told or gone)
    outside = staged and judged.cut_by_torque and missed
    if outside:
        said = "its cause may not be in the table"
        effects = tuple(e.doubted(said) for e in effects if e.confidence >= SHADOW)
    rows = judged.rows
    stages = stages_of(first, judged, effects)
    verdict = verdict_of(judged, effects, suspected=bool(first.effects) or not staged)
    stages = marked(stages, verdict, (*effects, *first.effects))
    unexplained = unexplained_of(judged, verdict, judged.unexplained)
    if held:
        why = RUNS_OUT if scales_of(judged.case.joint, judged.case.logs).coasts else HELD
        unexplained = replace(unexplained, text=f"{why}{told_in} {unexplained.text}")
    elif said := corrected(judged) if effects else refined(judged):
        unexplained = replace(unexplained, text=f"{said} {unexplained.text}".strip())
    load = stages["load"]
    if verdict == "explained" and load.after > max(ASTRAY, STILL * load.before):
        verdict, text = "partly_explained", unexplained.text.replace(NOTHING_LEFT, "")
        text = f"{text} {UNMOVED.format(plain(load.after))}".strip()
        unexplained = replace(unexplained, text=text)
    if outside:
        verdict = "partly_explained" if effects else "unexplained"
        text = f"{of_answer(judged)} {first.unexplained.text}".strip()
        unexplained = replace(first.unexplained, text=text)
    else:
        beside = first.unexplained.missing if staged else (first.unexplained.text,)
        text = " ".join((moving_together(judged, effects), unexplained.text, *beside)).strip()
        unexplained = replace(unexplained, text=text)
    return replace(
        first,
        verdict=verdict,
        stages=stages,
        effects=effects,
        gap=gap_of(judged),
        unexplained=unexplained,
        joint=joint_of(judged, effects, record, {e.name for e in by_torque if told_in is SET}),
        suggestion=_suggestion(judged, effects, first),
        evidence=pictured(judged, first.evidence),
        horizons=horizons_of(judged),
        regimes=first.regimes if rows else (),
    )


def marked(
    stages: Mapping[str, StageGap], verdict: str, effects: Sequence[NamedEffect]
) -> dict[str, StageGap]:
    """Return stages with a gap marked where a verdict leaves one.

    Of an explained gap none is the drive's unless an effect of the drive is named, which a current
    noisier than is stated seems to have.
    """
    none = set(stages) if verdict == "no_gap" else set()
    if verdict == "explained" and not any(e.stage == "drive" for e in effects):
        none = {"drive"}
    return {
        name: replace(gap, significant=gap.significant and name not in none)
        for name, gap in stages.items()
    }


def without_late_drive(effects: Sequence[NamedEffect], drive: StageGap) -> tuple[NamedEffect, ...]:
    """Return effects without delay and lag of a drive whose current follows as it should.

    The stage of a drive has a residual only if its current was measured.
    """
    quiet = drive.before > 0.0 and not drive.significant
    return tuple(e for e in effects if not (quiet and e.name in LATE))


def _as_staged(
    effects: Sequence[NamedEffect], staged: Sequence[NamedEffect]
) -> tuple[NamedEffect, ...]:
    """Return effects with the numbers of a late drive that the stages tell.

    They know that a row holds a command and what was measured before it acted.
    """
    late = {e.name: e.parameters for e in staged if e.name in LATE and e.stage == "drive"}
    return tuple(
        replace(e, parameters=late.get(e.name, e.parameters)) if e.stage == "drive" else e
        for e in effects
    )


def _beside(judged: Judgement, seen: Mapping[str, Spent]) -> dict[str, Spent]:
    """Return effects that the torque shows and that a predictive fit does not contradict.

    A fit with the effect must agree on its size, and not predict well with what the datasheet
    states; one without it must leave something unexplained, or be one whose record showed it and
    whose held-out record did not.
    """
    if judged.found is None:
        return {}
    fit = judged.found.base if judged.answer == "base" else judged.found.fit
    open_ = main_row(judged).found > NEAR
    terms = dict(zip(fit.model.terms, fit.model.values(fit.z), strict=True))
    fitted = {term.name: values for term, values in terms.items()}
    stated = set() if open_ else {t.name for t, v in terms.items() if _is_as_stated(judged, t, v)}
    return {
        name: one
        for name, one in seen.items()
        if agrees(one, judged.found.refuted.get(name, ()))
        or (agrees(one, fitted[name]) and name not in stated if name in fitted else open_)
    }


def _is_as_stated(judged: Judgement, term: Term, values: Sequence[float]) -> bool:
    """Return whether a fitted value keeps the tolerance that the datasheet states."""
    known = stated_tolerance(judged.case.joint, term)
    ratio = values[0] / term.nominal[0] if known is not None and term.nominal[0] else 0.0
    return known is not None and ratio > 0.0 and abs(math.log(ratio)) <= OUTSIDE * known


def _suggestion(judged: Judgement, effects: Sequence[NamedEffect], first: Diagnosis) -> Suggestion:
    """Return what to record next to distinguish the named effects from their rivals."""
    exam = first.examination
    alike = {e.name: e.confusable_with for e in effects}
    text = separating(alike, exam.advice if exam is not None else ())
    if not text and judged.unexplained:
        text = "Record slow and fast motion in both directions over the whole travel."
    return Suggestion(text or "Nothing more is needed on this record's range.")
