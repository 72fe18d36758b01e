"""Judgement of the stages' diagnosis by the predictions of its joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.errors import CjtGymError
from cjt_gym.gap.check.torque import KNOWN_TORQUE
from cjt_gym.gap.diagnosis import (
    ENOUGH,
    EVEN_CHANCE,
    MUCH_LEFT,
    NOTHING_LEFT,
    Diagnosis,
    Interval,
    NamedEffect,
    Unexplained,
)
from cjt_gym.gap.horizons.allowed import allowed_by
from cjt_gym.gap.horizons.by_torque import DRY
from cjt_gym.gap.horizons.case import as_joint, make_case
from cjt_gym.gap.horizons.held import held_alike
from cjt_gym.gap.horizons.inverse import drag_law
from cjt_gym.gap.horizons.judge import Progress, judge
from cjt_gym.gap.horizons.judgement import CLOSE, LOUD, NEAR, Judgement, Row
from cjt_gym.gap.horizons.model import MEASURES
from cjt_gym.gap.horizons.named import of_drive
from cjt_gym.gap.horizons.refined import (
    BESIDE,
    LATE,
    NAMELESS,
    corrected,
    gave_way,
    left_tolerance,
)
from cjt_gym.gap.horizons.tell import horizons_of, retold
from cjt_gym.gap.horizons.verdict import DRIFTLESS, main_row, unexplained_of
from cjt_gym.gap.horizons.windows import HORIZONS, TRIVIAL, relative
from cjt_gym.gap.horizons.write import found_at
from cjt_gym.gap.recorded.tolerances import OUTSIDE, is_left_open
from cjt_gym.joint import EFFECTS, JointFile, Structure
from cjt_gym.joint.quantity import freeze
from cjt_gym.records import Record

BETTER = 0.95
"""Relative error, as a fraction of the datasheet's, that at least one horizon must fall below for
an effect to be confirmed."""
OVER_THE_RECORD = (
    "One sample ahead the named effects explain what was measured; over the whole record the "
    "datasheet predicts better, so that its joint is the one given."
)
FURTHER = "The named effects help one sample ahead; further ahead hardly anything is predicted."
GAVE_WAY = "a value of the datasheet had to leave its tolerance beside it"
SETTLED = ("explained", "no_gap")
"""Verdicts of the stages that leave nothing unexplained."""
HALF, FLOORS = 0.5, 5.0
"""Limits on the ratio of an error to the datasheet's, and on that to the noise floor. A held output
counts as unexplained if it exceeds the second, and the first or `DRIFTLESS`."""
GONE = 0.2
"""Ratio to the datasheet's error below which the stages' effects stay confirmed nevertheless."""
MOSTLY = 0.5
"""Predictable share of the squared error above which the stages' effects explain too little."""
SILENT = 2.0
"""Residual of the drive, in units of noise, up to which its effects explain it."""
ROUNDED = "quantization"
"""Effect that no other can cause: values that lie on a lattice."""
UNDAMPED = "the spring's damping d_gl, not stated, may take its place"
"""Doubt of a hysteresis of a spring."""
DRAGS = ("damping", "viscous_asym")
"""Effects whose drag grows in proportion to the speed."""
AT_FLOOR = 1.1
"""Ratio of the datasheet's errors to their floors, which are estimates themselves, up to which
there is no gap."""
FAINT = 2e-3
"""Relative error up to which there is none either."""
OF_VALUES = {
    "k_t": "torque_constant", "k_b": "stiffness", "k_g": "gear_stiffness", "I_l": "load_inertia"
}  # fmt: skip
"""Effects that are no more than a value of the datasheet."""
ABOVE_THE_NOISE = "what is left is above the noise that the joint file states"
"""Doubt of a value whose stage does not come down to its noise."""
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
    """
    first = _without_open(first, file)
    if file.parameters.get("d_gl", 0.0) <= 0.0:
        effects = (
            e.doubted(UNDAMPED) if e.name == "spring_hysteresis" else e for e in first.effects
        )
        first = replace(first, effects=tuple(effects))
    exam = first.examination
    excluded = {row.name: row.why for row in exam.cannot_tell} if exam is not None else {}
    try:
        case = make_case(records, held, file, shape)
        stages = as_joint(first.joint, case) if first.evidence.regimes else None
        names, settled = [e.name for e in first.effects], first.verdict in SETTLED
        found = judge(case, stages, progress, names, excluded, explained=settled)
    except (CjtGymError, np.linalg.LinAlgError) as error:
        said = f"Predictions over several horizons were not possible: {error}"
        left = replace(first.unexplained, text=f"{first.unexplained.text} {said}")
        return allowed_by(replace(first, unexplained=left), excluded)
    if found.answer == "stages":
        first = replace(first, joint=replace(first.joint, found=found_at(found)))
        told = _held(_doubted(_cleared(first, found), found), found)
        told = _with_drag(_with_late_drive(told, found), found)
        told = _with_stated_value(told, found)
        strained = gave_way(found, told.effects)
        if strained:
            effects = (e if e.name in MEASURES else e.doubted(GAVE_WAY) for e in told.effects)
            advice = replace(told.suggestion, text=_instead(told.suggestion.text))
            told = replace(told, effects=tuple(effects), suggestion=advice)
        text = " ".join(filter(None, (corrected(found), strained, told.unexplained.text)))
        told = replace(told, unexplained=replace(told.unexplained, text=text))
        return allowed_by(replace(told, horizons=horizons_of(found)), excluded)
    told = retold(first, found, excluded, title_of(records[0]))
    told = _with_elsewhere(told, first, measured=any("i" in one for one in records))
    told = allowed_by(_with_drag(_with_late_drive(told, found), found), excluded)
    beside = any(e.name not in MEASURES for e in told.effects) and found.answer == "found"
    strained = gave_way(found, told.effects) if beside else ""
    text = " ".join(filter(None, (found.contradicted, strained, told.unexplained.text)))
    told = replace(told, unexplained=replace(told.unexplained, text=text))
    if found.answer == "datasheet" and found.cut and _near(found):
        return _suspected(told, first, first.effects, OVER_THE_RECORD)
    if not told.effects and not found.cut and main_row(found).found > LOUD:
        dry = tuple(e for e in first.effects if e.name in DRY)
        return _suspected(told, first, dry, FURTHER)
    return told


def at_the_floor(told: Diagnosis, file: JointFile, *, measured: bool) -> Diagnosis:
    """Return a diagnosis without a gap if the datasheet predicts as well as anything could.

    An effect then needs more than what it does one sample ahead. Those of sensors, and of a drive
    whose current was measured, do not change what is predicted.

    Args:
        told: The diagnosis.
        file: The nominal joint, with its structure.
        measured: Whether the current was measured.
    """
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


def _with_drag(told: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that confirms no damping where the drag has another law."""
    law = drag_law(found.case.joint, found.case.logs)
    if not law or any(e.name == "stribeck" and e.status == "confirmed" for e in told.effects):
        return told
    why = f"the drag grows {law} than in proportion to the speed"
    effects = (e.doubted(why) if e.name in DRAGS else e for e in told.effects)
    return replace(told, effects=tuple(effects))


def _with_stated_value(told: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that names the one stated value that left its tolerance.

    The stages refine a value before they look for effects. If what they leave is then more than the
    noise that is stated, they explain nothing, though nothing could predict better.
    """
    left, main = left_tolerance(found, told.effects), main_row(found)
    other = [e for e in told.effects if e.name not in MEASURES and e.stage != "drive"]
    ahead = [row for row in found.rows if row.seconds > min(HORIZONS)]
    best = all(row.found < max(CLOSE * (row.floor or 0.0), TRIVIAL) for row in ahead)
    if len(left) != 1 or other or not best or main.found > GONE * main.datasheet:
        return told
    (one,) = left
    name = OF_VALUES.get(one.symbols[0])
    if name is None or told.verdict not in ("partly_explained", "unexplained"):
        return told
    half = OUTSIDE * one.spread * one.value
    numbers = {one.symbols[0]: Interval(one.value, one.value - half, one.value + half, one.unit)}
    effect = NamedEffect(
        name, EFFECTS[name].stage, None, None, numbers, "tentative", EVEN_CHANCE,
        1.0 - (main.found / main.datasheet) ** 2, (), doubt=ABOVE_THE_NOISE,
    )  # fmt: skip
    text = "Nothing could predict better, but the stages leave more than the noise that is stated."
    open_ = Unexplained(0.0, None, text, 0.0, told.unexplained.missing)
    return replace(told, verdict="explained", effects=(effect, *told.effects), unexplained=open_)


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


def _cleared(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis without a gap if no part of the remaining error is predictable.

    Without a measured torque, a motor's one-step predictor does not know the torque of its spring.
    """
    open_ = found.cut or found.unexplained or any(row.left is None for row in found.rows[-1:])
    if first.verdict != "unexplained" or first.effects or open_:
        return first
    return replace(first.without_gap(), unexplained=Unexplained(0.0, None, NOTHING_LEFT, 0.0))


def _doubted(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that confirms and explains nothing unless predictions improve.

    Effects of sensors, and of a drive whose current was measured, do not change what is predicted.
    Effects with memory, such as temperature, show in the replay of a whole record rather than in
    its pieces.
    """
    gap = first.gap
    better = gap.after < BETTER * gap.before or any(
        row.found < BETTER * row.datasheet for row in found.rows
    )
    worse = gap.after > gap.before > TRIVIAL
    held = found.case.joint.structure_row.output_fixed
    far_off = held and gap.after > max(
        min(DRIFTLESS, HALF * gap.before), FLOORS * gap.floor, TRIVIAL
    )
    adrift = not held and any(
        row.found > 1.0
        for row in found.rows
        if row.channel != "tau" and row.seconds > min(HORIZONS)
    )
    main = main_row(found)
    left = gap.after if far_off else min(main.found, gap.after)
    predictable = [row for row in found.rows if _is_predictable(row) and not found.cut]
    sound = better and not (worse or far_off or adrift) and left < LOUD
    measured = found.case.logs[0].drive == "i"
    aside = {
        e.name for e in first.effects
        if e.name in MEASURES or (measured and e.stage == "drive")
    }  # fmt: skip
    unmoved = all(e.name in aside for e in first.effects) and main.found < NEAR
    unsure = all(e.name in aside or e.status == "tentative" for e in first.effects)
    mostly = gap.after > max(HALF * gap.before, FLOORS * gap.floor)
    mostly = mostly and unsure and not unmoved and main.found > HALF * main.datasheet
    if not first.effects or ((sound or unmoved) and not (predictable or mostly)):
        return first
    kept = sound and main.found < GONE * main.datasheet
    effects = tuple(e if kept or e.name in aside else e.doubted(MUCH_LEFT) for e in first.effects)
    said = f"With the named effects {min(left, 1.0):.0%} of what was measured is left."
    if first.verdict != "explained":
        said = f"{said[:-1]} in a replay of the held-out record. " if far_off else ""
        open_ = replace(first.unexplained, text=said + first.unexplained.text)
        return replace(first, effects=effects, unexplained=open_)
    if not better or worse:
        said = f"{said[:-1]}: they do not make predictions better."
    elif predictable:
        said = unexplained_of(found, "partly_explained", predictable).text
    elif mostly:
        said = f"Most of the gap is left: {gap.after / gap.before:.0%} of it in a replay."
    elif adrift:
        said = "Further ahead the joint given predicts no better than going on at the same speed."
    text = first.unexplained.text.replace(NOTHING_LEFT, "").strip()
    told = replace(first.unexplained, share=min(left, 1.0), text=f"{said} {text}".strip())
    return replace(first, verdict="partly_explained", effects=effects, unexplained=told)


def _with_late_drive(told: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis with the delay or lag of a drive of which more stays unexplained.

    The stages name nothing small there, but the current that was measured follows later. If a log
    is slower than the drive, they leave open when within a sample it was written, and see less.
    """
    known, drive = {e.name for e in told.effects}, found.case.drive
    late = drive is not None and drive.beyond_a_row
    if not (late or told.unexplained.stage == "drive") or known & LATE:
        return told
    verdict = {"no_gap": "explained"}.get(told.verdict, told.verdict)
    effects = (*told.effects, *of_drive(found))
    return replace(told, verdict=verdict if late else told.verdict, effects=effects)


def _held(first: Diagnosis, found: Judgement) -> Diagnosis:
    """Return a diagnosis that does not confirm what a held joint does not tell from others."""
    effects = []
    for effect in first.effects:
        if alike := held_alike(effect.name, found.joint, found.case.logs[0]):
            said = f"{' or '.join(alike)} may take its place"
            effect = effect.doubted(said).or_else(alike)
        effects.append(effect)
    return replace(first, effects=tuple(effects))


def _is_predictable(row: Row) -> bool:
    """Return whether most of an error seems predictable.

    It must not be small, and over the shortest horizon, which depends on the measured start, large.
    """
    least = NEAR if row.seconds > min(HORIZONS) else LOUD
    return row.found > least and row.left is not None and row.left.share > MOSTLY


def _without_open(first: Diagnosis, file: JointFile) -> Diagnosis:
    """Return a diagnosis in which datasheet values that are left open are no causes."""
    effects = tuple(
        e
        for e in first.effects
        if not is_left_open(file, e.name, {s: one.value for s, one in e.parameters.items()})
    )
    if effects == first.effects:
        return first
    if effects or first.unexplained.share:
        verdict = first.verdict if effects else "unexplained"
        return replace(first, verdict=verdict, effects=effects)
    return first.without_gap()


def _instead(advice: str) -> str:
    """Return advice that begins with what would tell which value of the datasheet is off."""
    return KNOWN_TORQUE if advice == ENOUGH else f"{KNOWN_TORQUE} {advice}"


def title_of(record: Record) -> str:
    """Return a short name of a record: that of its file."""
    return record.owner if record.origin is None else record.origin.stem
