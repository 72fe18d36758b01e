"""The diagnosis of the stages, judged by what its joint predicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.check import examine
from cjt_gym.gap.diagnosis import NOTHING_LEFT, Diagnosis, Unexplained
from cjt_gym.gap.horizons.judge import TRIVIAL, Judgement, Progress, as_joint, judge, make_case
from cjt_gym.gap.horizons.tell import horizons_of, retold
from cjt_gym.gap.horizons.windows import HORIZONS, relative
from cjt_gym.gap.horizons.write import found_at
from cjt_gym.joint import JointFile, Structure
from cjt_gym.records import Record

FAR_OFF = 2.0
"""Relative error, over that of the datasheet, from which what the stages suspect is not told."""


def judged(
    first: Diagnosis,
    records: Sequence[Record],
    held: Sequence[Record],
    file: JointFile,
    shape: Structure,
    progress: Progress,
) -> Diagnosis:
    """Return a diagnosis whose joint predicts well at all horizons, or the better of the others.

    Args:
        first: What the stages' predictors have found.
        records: The records that are explained, whole.
        held: Those on which the explanation is tested.
        file: The nominal joint.
        shape: How its bodies are joined.
        progress: Is told in words what is being done.
    """
    exam = examine(list(records), file, shape)
    first = replace(first, examination=exam)
    excluded = {row.name: row.why for row in exam.cannot_tell}
    try:
        case = make_case(records, held, file, shape)
        stages = as_joint(first.joint, case) if first.evidence.t.size else None
        found = judge(case, stages, progress, [effect.name for effect in first.effects])
    except (CjtGymError, np.linalg.LinAlgError) as error:
        said = f"Predictions over several horizons were not possible: {error}"
        left = replace(first.unexplained, text=f"{first.unexplained.text} {said}")
        return _allowed(replace(first, unexplained=left), excluded)
    if found.answer == "stages":
        first = replace(first, joint=replace(first.joint, found=found_at(found)))
        return _allowed(replace(_cleared(first, found), horizons=horizons_of(found)), excluded)
    told = retold(first, found, excluded, _title(records[0]))
    if found.answer == "datasheet" and found.cut and _near(found):
        return _suspected(told, first)
    return told


def _near(found: Judgement) -> bool:
    """Return whether the joint of the stages predicts less than twice as badly as the datasheet."""
    windows = found.case.test
    if "stages" not in found.errors:
        return False
    own, other = (relative(windows, found.errors[name]) for name in ("stages", "datasheet"))
    return all(own[k] < FAR_OFF * max(other[k], TRIVIAL) for k in own if k[1] != min(HORIZONS))


def _suspected(told: Diagnosis, first: Diagnosis) -> Diagnosis:
    """Return a diagnosis with what the stages suspect, of which nothing is confirmed."""
    if not first.effects:
        return told
    effects = tuple(
        replace(e, status="tentative", confidence=min(e.confidence, 0.5)) for e in first.effects
    )
    said = (
        "One sample ahead the named effects explain what was measured; over the whole record the "
        "datasheet predicts better, so that its joint is the one given."
    )
    left = replace(told.unexplained, text=f"{said} {first.unexplained.text}")
    return replace(told, verdict="partly_explained", effects=effects, unexplained=left)


def _cleared(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that sees no gap where nothing of what is left could be predicted.

    Without a measured torque a motor's one-step predictor does not know what its spring does.
    """
    open_ = found.cut or found.unexplained or any(row.left is None for row in found.rows[-1:])
    if first.verdict != "unexplained" or first.effects or open_:
        return first
    told = Unexplained(0.0, None, NOTHING_LEFT, 0.0)
    stages = {name: replace(gap, significant=False) for name, gap in first.stages.items()}
    return replace(first, verdict="no_gap", unexplained=told, stages=stages)


def _allowed(first: Diagnosis, excluded: dict[str, str]) -> Diagnosis:
    """Return a diagnosis that confirms nothing which the record cannot tell."""
    effects = tuple(
        replace(e, status="tentative", confidence=min(e.confidence, 0.5))
        if e.name in excluded and e.status == "confirmed"
        else e
        for e in first.effects
    )
    return replace(first, effects=effects)


def _title(record: Record) -> str:
    return record.owner if record.origin is None else record.origin.stem
