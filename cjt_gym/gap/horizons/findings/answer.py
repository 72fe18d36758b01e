"""Judgement of the stages' diagnosis by the predictions of its joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.check.contradictions import is_count
from cjt_gym.gap.diagnosis import (
    NOTHING_LEFT,
    Diagnosis,
    NamedEffect,
    Suggestion,
    Unexplained,
    told_symbols,
)
from cjt_gym.gap.horizons.findings.as_diagnosis import retold
from cjt_gym.gap.horizons.findings.by_torque import DRY
from cjt_gym.gap.horizons.findings.corrected_values import BESIDE, LATE, NAMELESS, gave_way, refined
from cjt_gym.gap.horizons.findings.disturbance import disturbed
from cjt_gym.gap.horizons.findings.late_drive import with_dead_time, with_late_drive
from cjt_gym.gap.horizons.findings.misfit import Wider, widened
from cjt_gym.gap.horizons.findings.naming import as_plain
from cjt_gym.gap.horizons.findings.not_confirmed import allowed_by
from cjt_gym.gap.horizons.findings.stages_kept import (
    BETTER,
    standing,
    with_drag,
    without_open,
)
from cjt_gym.gap.horizons.findings.verdict import main_row
from cjt_gym.gap.horizons.prediction.case import as_joint, make_case
from cjt_gym.gap.horizons.prediction.model import MEASURES
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, relative
from cjt_gym.gap.horizons.selection.judge import Progress, judge
from cjt_gym.gap.horizons.selection.judgement import LOUD, Judgement
from cjt_gym.gap.recorded.moved import strain
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.files.quantity import Quantity, freeze
from cjt_gym.joint.files.quantity import Setting as Entry
from cjt_gym.records import Record

SILENT = 2.0
"""Residual of the drive, in units of noise, up to which its effects explain it."""
ROUNDED = "quantization"
"""Effect that no other can cause: values that lie on a lattice."""
OVER_THE_RECORD = (
    "One sample ahead the named effects explain what was measured; over the whole record the "
    "datasheet predicts better, so that its joint is the one given."
)
FURTHER = "The named effects help one sample ahead; further ahead hardly anything is predicted."
CALLED_FOR = "The fitted records call for"
MISCOUNTED = "counts_per_rev of the mapping may be too small by this factor instead"
UNDISTURBED = "Record again without what acted there, or leave that stretch out."
SETTLED = ("explained", "no_gap")
"""Verdicts of the stages that leave nothing unexplained."""
AT_FLOOR = 1.1
"""Ratio of the datasheet's errors to their floors, which are estimates themselves, up to which
there is no gap."""
FAINT = 2e-3
"""Relative error up to which there is none either."""
SCALES = {"torque_gain": "stiffness", "stiffness": "torque_gain"}
"""What may take the place of a scale where other values leave their tolerances beside it."""
FAR_OFF = 2.0
"""Ratio to the datasheet's relative error at which the stages' suspects are not reported."""


def judged(
    first: Diagnosis,
    records: Sequence[Record],
    held: Sequence[Record],
    file: JointFile,
    shape: Structure,
    progress: Progress,
) -> Diagnosis:
    """Return a diagnosis whose joint predicts well at all horizons, or else the best alternative.

    Args:
        first: Diagnosis of the stages' predictors, with the examination of the records.
        records: Complete records to explain.
        held: Held-out records on which the explanation is tested.
        file: The nominal joint.
        shape: Structure of the joint.
        progress: Called with a description of the current step.

    Raises:
        CjtGymError: Neither stages nor predictions tell anything; the message says why.
    """
    first = without_open(first, file)
    exam = first.examination
    excluded = {row.name: row.why for row in exam.cannot_tell} if exam is not None else {}
    try:
        case = make_case(records, held, file, shape)
        stages = as_joint(first.joint, case) if first.evidence.regimes else None
        names, settled = [e.name for e in first.effects], first.verdict in SETTLED
        found = judge(case, stages, progress, names, excluded, explained=settled)
    except (CjtGymError, np.linalg.LinAlgError) as error:
        if isinstance(error, CjtGymError) and not first.evidence.regimes:
            raise
        said = f"Predictions over several horizons were not possible: {error}"
        left = replace(first.unexplained, text=f"{first.unexplained.text} {said}")
        return allowed_by(replace(first, unexplained=left), excluded)
    measured = any("i" in one for one in records)
    told = _told(first, found, excluded, title_of(*records), measured=measured)
    told = _as_sure_as_datasheet(told, file, felt=any("tau" in one for one in records))
    return _with_disturbance(_with_counts(told, file), found, records, held)


def _told(
    first: Diagnosis, found: Judgement, excluded: dict[str, str], title: str, *, measured: bool
) -> Diagnosis:
    """Return the diagnosis of the joint that is the answer."""
    if found.answer == "stages":
        told = allowed_by(with_dead_time(standing(first, found), found, excluded), excluded)
        text = f"{_contradicted(found)} {told.unexplained.text}".strip()
        left = replace(told.unexplained, text=text)
        effects = tuple(as_plain(effect) for effect in told.effects)
        return replace(told, effects=effects, unexplained=left)
    told = retold(first, found, excluded, title)
    told = _with_elsewhere(told, first, measured=measured)
    told = with_dead_time(with_late_drive(told, found), found, excluded)
    told = allowed_by(with_drag(told, found), excluded)
    beside = any(e.name not in MEASURES for e in told.effects) and found.answer == "found"
    strained = gave_way(found, told.effects) if beside else ""
    said = (_ahead(found), _contradicted(found), strained, told.unexplained.text)
    text = " ".join(filter(None, said))
    told = replace(told, unexplained=replace(told.unexplained, text=text))
    if found.answer == "datasheet" and found.cut_by_torque and _near(found):
        return _suspected(told, first, first.effects, OVER_THE_RECORD)
    if not told.effects and not found.cut_by_torque and main_row(found).found > LOUD:
        dry = tuple(e for e in first.effects if e.name in DRY)
        return _suspected(told, first, dry, FURTHER)
    return told


def _as_sure_as_datasheet(told: Diagnosis, file: JointFile, *, felt: bool) -> Diagnosis:
    """Return a diagnosis whose intervals are wider where values leave their tolerances together.

    Something that the datasheet states is wrong by more than it says then, and what is not told
    apart shares the error: the scale of all torques, a spring or an inertia. A spring that is off
    then looks like a wrong scale of its torque sensor, where the torque was measured (`felt`).
    """
    factor = strain(file, told.joint, told_symbols(told.effects))
    if factor == 1.0:
        return told
    spared = [e.name for e in told.effects if e.name in MEASURES or e.stage == "drive"]
    told = widened(told, Wider(factor), spared)
    joint, known = told.joint, file.parameters.quantities
    p = joint.parameters
    rows = {n: _looser(r, file.effects.get(n, {}), factor) for n, r in joint.effects.items()}
    looser = _looser({s: q for s, q in p.quantities.items() if s in known}, known, factor)
    joint = replace(joint, parameters=p.replace(**looser), effects=rows)
    told = replace(told, joint=joint)
    if not felt:
        return told
    effects = (
        e.doubted(f"{SCALES[e.name]} may take its place").or_else([SCALES[e.name]])
        if e.name in SCALES
        else e
        for e in told.effects
    )
    return replace(told, effects=tuple(effects))


def _looser(row: Mapping[str, Entry], known: Mapping[str, Entry], factor: float) -> dict[str, Any]:
    """Return a row with the tolerances of its refined values larger by a factor."""
    return {
        s: replace(q, tolerance=factor * q.tolerance)
        if isinstance(q, Quantity) and q.tolerance and q != known.get(s)
        else q
        for s, q in row.items()
    }


def _ahead(found: Judgement) -> str:
    """Return that the motion is ahead of the current that is its input, "" if it is not.

    Where hardly anything is predicted, no instant of the current is better than another.
    """
    log = found.case.logs[0]
    if not log.early or main_row(found).found > LOUD:
        return ""
    late = 1e3 * log.early * log.dt / log.rows
    return (
        f"The motion is best predicted by the current of {log.early:.2g} rows later ({late:.2g} "
        f"ms): i is logged late. Map i with samples_late = {round(log.early)}, or that much more."
    )


def _with_counts(told: Diagnosis, file: JointFile) -> Diagnosis:
    """Return a diagnosis that confirms no coarser encoder where its counts may be wrong instead."""
    effects = []
    for e in told.effects:
        stated = file.sensors.get(e.channel or "", {}).get("resolution")
        seen = e.parameters.get("resolution")
        if e.name == ROUNDED and stated is not None and seen is not None and stated.number > 0.0:
            e = e.doubted(MISCOUNTED) if is_count(seen.value / stated.number) else e
        effects.append(e)
    return replace(told, effects=tuple(effects))


def _with_disturbance(
    told: Diagnosis, found: Judgement, records: Sequence[Record], held: Sequence[Record]
) -> Diagnosis:
    """Return a diagnosis that says in which stretch of a record something else acted."""
    said = []
    parts = [(records, found.case.fit), *([(held, found.case.test)] if held else [])]
    for given, windows in parts:
        one = disturbed(windows, found.joint)
        if one is not None and one.log < len(given):
            said.append(
                f"{one.share:.0%} of what is left of the motion in {title_of(given[one.log])} lies "
                f"from {one.start:.3g} to {one.stop:.3g} s: look at what acted there."
            )
    if not said:
        return told
    left = replace(told.unexplained, text=" ".join([*said, told.unexplained.text]).strip())
    if told.verdict != "no_gap":
        return replace(told, unexplained=left)
    left = replace(left, text=left.text.replace(NOTHING_LEFT, "").strip())
    advice = Suggestion(UNDISTURBED)
    return replace(told, verdict="unexplained", unexplained=left, suggestion=advice)


def _contradicted(found: Judgement) -> str:
    """Return how held-out records contradict the fitted ones, and what these call for."""
    if not found.contradicted or found.found is None:
        return found.contradicted
    asked = refined(replace(found, answer="found"), known=True).replace(NAMELESS, CALLED_FOR)
    return f"{found.contradicted} {asked}".rstrip()


def at_the_floor(told: Diagnosis, file: JointFile, *, measured: bool) -> Diagnosis:
    """Return a diagnosis without a gap if the datasheet predicts as well as anything could.

    An effect then needs more than what it does one sample ahead. Those of sensors, and of a drive
    whose current was measured, do not change what is predicted.

    Args:
        told: The diagnosis.
        file: The nominal joint, with its structure.
        measured: Whether the current was measured.
    """
    if told.suggestion.text == UNDISTURBED:
        return told  # what acted without a pattern is in the floor, too
    gap, ahead = told.gap, [row for row in told.horizons if row.seconds > min(HORIZONS)]
    errors = [(row.datasheet, row.floor or 0.0, row.found) for row in ahead]
    errors.append((gap.before, gap.floor, gap.after))
    better = any(after < BETTER * before for before, _, after in errors)
    aside = [e for e in told.effects if e.name in MEASURES or (measured and e.stage == "drive")]
    sure = bool(aside) or (better and any(e.status == "confirmed" for e in told.effects))
    if sure or not ahead or any(e > max(AT_FLOOR * floor, FAINT) for e, floor, _ in errors):
        return told
    gap = replace(gap, after=gap.before, removed=0.0, low=0.0, high=0.0)
    rows = tuple(replace(row, found=row.datasheet) for row in told.horizons)
    left = Unexplained(0.0, None, NOTHING_LEFT, 0.0, told.unexplained.missing)
    known = {key: x for key, x in told.joint.found.items() if key != "covariance"}
    joint = replace(file, found=freeze(known))
    return replace(told.without_gap(), gap=gap, horizons=rows, unexplained=left, joint=joint)


def _with_elsewhere(told: Diagnosis, first: Diagnosis, *, measured: bool) -> Diagnosis:
    """Return a diagnosis with what the stages found where predictions of motion do not look.

    These are faults of sensors, and those of a drive whose current was measured.
    """
    driven = measured and first.stages["drive"].after < SILENT
    own = {e.name for e in first.effects if driven and e.stage == "drive"}
    if own - LATE:  # what bends or clips a current may pass for a delay
        kept = tuple(e for e in told.effects if e.name not in LATE - own)
        told = replace(told, effects=kept)
    known = {e.name for e in told.effects} | LATE
    seen = [
        e
        for e in first.effects
        if e.name in MEASURES or (driven and e.stage == "drive" and e.name not in known)
    ]
    if first.verdict not in SETTLED:  # something else may have scattered a channel, but not rounded
        sure = told.verdict != "no_gap"
        said = "what stays unexplained may be its cause"
        seen = [e.doubted(said) for e in seen if sure or e.name == ROUNDED or e.stage == "drive"]
    if not seen or (told.verdict == "unexplained" and all(map(_is_mere_noise, seen))):
        return told
    least = min((e.gap_removed for e in told.effects), default=1.0)
    more = [replace(e, gap_removed=min(e.gap_removed, least)) for e in seen]
    verdict = {"no_gap": "explained", "unexplained": "partly_explained"}
    left = replace(told.unexplained, text=told.unexplained.text.replace(NAMELESS, BESIDE))
    return replace(
        told,
        effects=tuple(sorted((*told.effects, *more), key=_follows_a_sure_drive)),
        verdict=verdict.get(told.verdict, told.verdict),
        unexplained=left,
    )


def _is_mere_noise(effect: NamedEffect) -> bool:
    """Return whether an effect explains no part of a gap in the motion, nor is sure by itself."""
    return effect.name in MEASURES and effect.status == "tentative"


def _follows_a_sure_drive(effect: NamedEffect) -> bool:
    """Return whether an effect is listed after the confirmed effects of a drive."""
    return effect.stage != "drive" or effect.status != "confirmed"


def _near(found: Judgement) -> bool:
    """Return whether the error of the stages' joint is less than twice the datasheet's."""
    windows = found.case.test
    if "stages" not in found.errors:
        return False
    own, other = (relative(windows, found.errors[name]) for name in ("stages", "datasheet"))
    return all(own[k] < FAR_OFF * max(other[k], TRIVIAL) for k in own if k[1] != min(HORIZONS))


def _suspected(
    told: Diagnosis, first: Diagnosis, effects: Sequence[NamedEffect], said: str
) -> Diagnosis:
    """Return a diagnosis with the effects suspected by the stages, all of them tentative."""
    if not effects:
        return told
    left = replace(told.unexplained, text=f"{said} {first.unexplained.text}")
    suspects = tuple(e.doubted("it helps one sample ahead only") for e in effects)
    return replace(told, verdict="partly_explained", effects=suspects, unexplained=left)


def title_of(*records: Record) -> str:
    """Return a short name of records: that of the first one's file, and how many there are more.

    Parts of one file are one record.
    """
    names = (r.owner if r.origin is None else r.origin.stem for r in records)
    name, *more = dict.fromkeys(names)
    return f"{name} and {len(more)} more" if more else name
