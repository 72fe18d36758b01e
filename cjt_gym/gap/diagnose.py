"""From records to a diagnosis."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from cjt_gym.errors import ConfigurationError, RecordError
from cjt_gym.gap.by_stages import Ask, by_stages
from cjt_gym.gap.candidates.separated import separating
from cjt_gym.gap.check import examination_of
from cjt_gym.gap.check.energy import NOT_THE_INPUT
from cjt_gym.gap.check.faults import FACTOR, LIMITS, OTHERS, REFLECTED, SCALES, SLOPES, UNITS
from cjt_gym.gap.check.instants import in_step
from cjt_gym.gap.diagnosis import ENOUGH, NOTHING_LEFT, Diagnosis, Suggestion, told_symbols
from cjt_gym.gap.digits import plain
from cjt_gym.gap.horizons.findings.answer import at_the_floor, judged, title_of
from cjt_gym.gap.horizons.findings.not_confirmed import allowed_by
from cjt_gym.gap.horizons.prediction.model import MEASURES
from cjt_gym.gap.identified import with_sensors
from cjt_gym.gap.next_record.suggest import ELSEWHERE
from cjt_gym.gap.proportions import proportions
from cjt_gym.gap.recorded.bridged import bridged
from cjt_gym.gap.recorded.driven import driven_only, is_left
from cjt_gym.gap.recorded.given import JointLike, as_records, nominal_joint
from cjt_gym.gap.recorded.listed import as_values
from cjt_gym.gap.recorded.moved import moved_symbols
from cjt_gym.gap.recorded.orient import all_oriented
from cjt_gym.gap.recorded.series import SHORTEST, Stretch, stretches
from cjt_gym.gap.recorded.spring_damping import unstated_damping, with_spring_damping
from cjt_gym.gap.recorded.tolerances import strained, unlisted, unnamed
from cjt_gym.gap.recorded.usable import check_one_joint, measured_only, unmeasured
from cjt_gym.gap.stages.select import Progress, silent
from cjt_gym.gap.stages.smoothing import with_smoothing
from cjt_gym.joint import JointFile
from cjt_gym.joint.structures import Structure
from cjt_gym.records import Record
from cjt_gym.records.doubts import SLOW_LOG

LOOSE, ASTRAY = 5.0, 50.0
"""Residuals of the drive, in units of noise, above which it is told beside no gap of the drive, and
above which nothing counts as explained. Of real drives 12 was the largest, of exchanged columns 600
and more."""
UNDONE = {"explained": "partly_explained", "no_gap": "unexplained"}
"""What a verdict becomes where the current does not follow its command at all."""
MOST = 0.5
"""Share of a log above which it need not be said that the rest of it was not used."""


@np.errstate(all="ignore")  # a trial step of a fit may overflow; it is then rejected
def diagnose(
    records: Record | Sequence[Record],
    joint: JointLike | None = None,
    structure: str | Structure | None = None,
    validate: Record | Sequence[Record] | None = None,
    progress: Progress = silent,
) -> Diagnosis:
    """Return where the gap between a joint and its simulation is, why, and how far it shrinks.

    Args:
        records: The records. Several records of one joint are explained together: they share its
            values and effects, but each has its own offsets and zeros.
        joint: The nominal joint, or its name or path; by default the one that the record names.
        structure: How its bodies are joined; by default as the record or else the joint states.
        validate: Further records, with other excitation, on which the explanation is tested; by
            default the last fifth of every record is held out for this.
        progress: Called with a description of the current step.

    Raises:
        CjtGymError: The records, the joint or the structure cannot be used; the message says why.

    Example:
        >>> from cjt_gym.records import read_record
        >>> diagnose(read_record("emps").slice(0, 6000)).to_dict()["schema"]
        1
    """
    started = time.perf_counter()
    given = as_records(records, "diagnose")
    held = [] if validate is None else as_records(validate, "diagnose")
    if not given:
        raise ConfigurationError("diagnose needs a record, got none.")
    first = given[0]
    if joint is None:
        check_one_joint([*given, *held])
    file, shape = nominal_joint(first, joint, structure)
    file = as_values(file, shape)
    for record in (*given, *held):
        _check_rate(record)
        _check_drive(record, file)
    _check_apart(given, held)
    _check_tests(held)
    (given, turned), (held, also) = (all_oriented(some, file, shape) for some in (given, held))
    exam = examination_of(given, file, shape)
    if any(NOT_THE_INPUT in fault for fault in exam.faults):
        raise _driven_by_another(first)
    for record in (*given, *held):
        _check_angle(record)
    if (exam.at_rest or exam.hardly_moves) and set(exam.can_tell) <= set(MEASURES):
        raise _nothing_moves(first)
    absent = {name: said for one in given for name, (_, said) in unmeasured(one).items()}
    remarks = list(dict.fromkeys(repair.text for repair in (*turned, *also)))
    remarks += [f"{name} {said}, and was not used." for name, said in absent.items()]
    driven, moved = driven_only(bridged(measured_only([*given, *held]))[0], shape)
    remarks += moved
    parts = driven[: len(given)], driven[len(given) :]
    given, held = ([one for one in some if is_left(one)] for some in parts)
    if not given:
        raise _driven_by_another(first)
    given, held = in_step(given, held, file, shape)
    pieces = stretches(given)
    file = with_smoothing(file, shape, pieces)
    with threadpool_limits(1, "blas"):  # for small matrices threads cost more than they gain
        turnable = len(given) == len(held) == 1
        damped = with_spring_damping(file, shape)
        staged = by_stages(pieces, stretches(held), damped, shape, progress, turnable=turnable)
        ask, open_ = staged.ask, staged.diagnosis.suggestion
        found = replace(staged.diagnosis, examination=exam)
        if exam.at_rest:
            excluded = {row.name: row.why for row in exam.cannot_tell}
            found = allowed_by(_drive_alone(found, first, file, shape), excluded)
        else:
            found = judged(found, given, held, file, shape, progress)
            known = any("i" in one for one in given)
            found = at_the_floor(found, replace(file, structure=shape.name), measured=known)
        names = [e.name for e in found.effects]
        remarks += [*unlisted(file, found.joint, names), *unnamed(file, found.joint, names)]
        if found.verdict != "no_gap":
            alone = shape.output_fixed and not any("tau" in one for one in given)
            remarks += unstated_damping(file, found.joint, alone=alone)
        joint = with_sensors(found.joint, found.effects, title_of(*given))
        found = replace(found, joint=joint)
        if ask is not None and found.suggestion is open_:
            progress("looking for the record that would tell most")
            found = replace(found, suggestion=_asked(ask))
    doubtful = {e.name: e.confusable_with for e in found.effects if e.status == "tentative"}
    if doubtful and found.suggestion.text == ENOUGH:
        text = separating(doubtful, exam.advice)
        found = replace(found, suggestion=Suggestion(text or ENOUGH))
    named = told_symbols(found.effects)
    told = strained(file, found.joint, named)
    found = replace(found, moved=moved_symbols(file, found.joint, named))
    scaled = any(name in one for one in given for name in ("tau", "tau_l"))
    ratios = "" if scaled else proportions(found.joint)
    text = " ".join((*told, found.unexplained.text, ratios)).strip()
    found = replace(found, unexplained=replace(found.unexplained, text=text))
    found = replace(found, seconds=time.perf_counter() - started)
    return remarked(found, given, pieces, shape, remarks)


def _check_angle(record: Record) -> None:
    """Reject a record in which the motor's angle is dead while its velocity moves."""
    if not {"q_m", "dq_m"} <= record.keys():
        return
    q, dq = record["q_m"], record["dq_m"]
    if np.isfinite(q).any() and np.nanmax(q) == np.nanmin(q) and np.nanmax(dq) > np.nanmin(dq):
        raise RecordError(
            f"{record.owner}: q_m never changes, though dq_m does. Map the column of the motor's "
            "angle as q_m, or leave q_m out: the velocity suffices."
        )


def _driven_by_another(record: Record) -> RecordError:
    return RecordError(
        f"{record.owner}: something other than the motor drives the joint throughout. Map its "
        "torque as tau_l, or record what the motor drives alone."
    )


def _nothing_moves(record: Record) -> RecordError:
    return RecordError(
        f"{record.owner}: nothing moves by more than its noise, or all of it from one row to the "
        "next or within a few rows, so that the record cannot tell what moves the joint. Record "
        "motion: drive the joint far enough that it turns by a thousand counts, and log a hundred "
        "rows for each of its swings. cjt-gym check says what else to record."
    )


def _drive_alone(found: Diagnosis, record: Record, file: JointFile, shape: Structure) -> Diagnosis:
    """Return the diagnosis of a joint that does not move: that of its drive, if it has a gap."""
    effects = tuple(e for e in found.effects if e.stage == "drive")
    if not effects:
        raise _nothing_moves(record)
    left = replace(found.unexplained, text="Nothing moves: only the drive was judged.")
    joint = replace(file, structure=shape.name)
    return replace(found, effects=effects, joint=joint, unexplained=left)


def _check_rate(record: Record) -> None:
    """Refuse a record whose samples are too far apart to show a motion."""
    dt = float(np.median(np.diff(record.t))) if len(record) > 1 else 0.0
    if dt > SLOW_LOG:
        raise RecordError(
            f"{record.owner} must have a sample every {SLOW_LOG:g} s or more often to be "
            f"diagnosed, got one every {dt:.3g} s. If its times are milliseconds, map t with "
            "unit = 'ms'."
        )


def _check_apart(given: Sequence[Record], held: Sequence[Record]) -> None:
    """Refuse a record that is given twice: it would count double, or test itself."""
    seen: list[tuple[Record, bool]] = []
    for record, tests in (*((one, False) for one in given), *((one, True) for one in held)):
        for other, tested in seen:
            if _is_same(record, other):
                why = "fitted and held out at once" if tests and not tested else "given twice"
                raise RecordError(
                    f"Records must differ, got {record.owner} with the samples of {other.owner}, "
                    f"{why}. Leave one of them out, or record another motion."
                )
        seen.append((record, tests))


def _check_tests(held: Sequence[Record]) -> None:
    """Refuse records to test on of which none is long enough for that."""
    if held and all(len(record) < SHORTEST for record in held):
        most = max(held, key=len)
        raise RecordError(
            f"{most.owner} must have at least {SHORTEST} samples to test a diagnosis on, got "
            f"{len(most)}. Give a longer record, or none: part of the first is then held out."
        )


def _is_same(one: Record, other: Record) -> bool:
    """Return whether two records hold the same samples."""
    alike = len(one) == len(other) and set(one.columns) == set(other.columns)
    return alike and all(np.array_equal(one[n], other[n], equal_nan=True) for n in one.columns)


def _check_drive(record: Record, file: JointFile) -> None:
    """Refuse a voltage in place of the current that the torque constant needs."""
    unit = file.parameters.unit("k_t")
    if record.units.get("i_cmd") == "V" and unit.endswith("/A"):
        raise RecordError(
            f"i_cmd of {record.owner} must be a current, as k_t of {file.parameters.name} is in "
            f"{unit}, got volts. Map the voltage as v, for a joint with r and drive = 'static', or "
            "give k_t as a gain in N m/V."
        )


def _asked(ask: Ask) -> Suggestion:
    """Return what to record next, in general terms if no experiment can be designed."""
    try:
        return ask()
    except (np.linalg.LinAlgError, ValueError):
        return Suggestion(ELSEWHERE)


def remarked(
    found: Diagnosis,
    given: Sequence[Record],
    used: Sequence[Stretch],
    shape: Structure,
    others: Sequence[str],
) -> Diagnosis:
    """Return a diagnosis that begins with what its reader has to know of the log."""
    remarks = [*others]
    advice = set() if found.examination is None else {*found.examination.advice}
    if OTHERS in advice:
        remarks.append(
            "Something other than the motor moves the joint as well, and no model of the joint "
            "predicts that: see the faults of the log."
        )
    spring = any(e.stage == "transmission" and e.status == "confirmed" for e in found.effects)
    resolved = found.verdict == "explained" and spring  # it makes tau other than k_b says
    if {FACTOR, LIMITS, REFLECTED, SCALES, SLOPES, UNITS} & advice and not resolved:
        remarks.append(
            "Channels contradict each other or the joint, as with a wrong unit, sign or side: see "
            "the faults of the log before you rely on the rest."
        )
    drive = found.stages.get("drive")
    if drive is not None and not drive.significant and drive.after > LOOSE:
        remarks.append(
            "The current follows its command less closely than noise allows (a residual of "
            f"{plain(drive.after)}), and predictions start from the current: no effect of the "
            "drive explains it, as where its loop is faster than the log."
        )
    if drive is not None and drive.after > ASTRAY and found.verdict in UNDONE:
        left = replace(found.unexplained, text=found.unexplained.text.replace(NOTHING_LEFT, ""))
        found = replace(found, verdict=UNDONE[found.verdict], unexplained=left)
        remarks.append("Look at the columns of i and i_cmd: current and command differ by far.")
    parts = [one.record for one in used]
    total, kept = (sum(float(x.t[-1] - x.t[0]) for x in some) for some in (given, parts))
    if kept <= MOST * total:
        remarks.append(
            f"Of the {total:.3g} s of the log the stages could use {kept:.3g} s: it has gaps, and "
            "the rest lies in pieces that are too short. Log without gaps."
        )
    first = given[0]
    if first.structure not in (None, shape.name):
        stated = f"{first.owner} states {first.structure}"
        remarks.append(f"{stated}, but was diagnosed as {shape.name}.")
    text = " ".join((*remarks, found.unexplained.text)).strip()
    return replace(found, unexplained=replace(found.unexplained, text=text))
