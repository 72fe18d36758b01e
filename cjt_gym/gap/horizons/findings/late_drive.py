"""Delays of the drive that neither stages nor predictions tell, but a current or a torque does."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.horizons.findings.by_torque import told_by_torque
from cjt_gym.gap.horizons.findings.corrected_values import LATE
from cjt_gym.gap.horizons.findings.naming import of_drive
from cjt_gym.gap.horizons.prediction.case import as_joint
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.horizons.selection.choice import WORSE
from cjt_gym.gap.horizons.selection.judgement import Judgement
from cjt_gym.gap.horizons.torque.dead_time import DELAY, dead_time
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.quantity import Quantity

SOURCE = "regression of the torque on the motion"


def with_late_drive(told: Diagnosis, found: Judgement) -> Diagnosis:
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


def with_dead_time(told: Diagnosis, found: Judgement, excluded: Collection[str]) -> Diagnosis:
    """Return a diagnosis with a dead time of the command that the torque alone shows.

    The joint has it, too, if it predicts no worse so.
    """
    if told.verdict == "no_gap" or DELAY in excluded or LATE & {e.name for e in told.effects}:
        return told
    late = dead_time(found.case.joint, found.case.logs)
    if late is None:
        return told
    named = told_by_torque(found, {DELAY: late}, told.effects, excluded, alone=False)
    rows = {
        s: Quantity(x.value, x.unit, SOURCE, low=x.low, high=x.high)
        for e in named
        for s, x in e.parameters.items()
    }
    if not named:
        return told
    verdict = {"unexplained": "partly_explained"}.get(told.verdict, told.verdict)
    joint = _with_row(told.joint, rows, found)
    return replace(told, verdict=verdict, effects=(*told.effects, *named), joint=joint)


def _with_row(file: JointFile, rows: dict[str, Quantity], found: Judgement) -> JointFile:
    """Return a joint with a delay, unless it has one or predicts worse so."""
    if LATE & file.effects.keys():
        return file
    delayed = replace(file, effects={**file.effects, DELAY: rows})
    windows = found.case.test
    without, with_it = (
        relative(windows, windows.errors(as_joint(one, found.case))) for one in (file, delayed)
    )
    no_worse = all(with_it[key] <= WORSE * without[key] for key in without)
    return delayed if no_worse else file
