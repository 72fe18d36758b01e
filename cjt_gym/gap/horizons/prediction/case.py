"""Records, split into fitted and held-out parts, and the joint that they describe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cjt_gym.gap.horizons.prediction.angle_noise import speed_noise
from cjt_gym.gap.horizons.prediction.drive import DriveFit, fit_drive
from cjt_gym.gap.horizons.prediction.log import SMOOTH, Log, to_logs
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.horizons.prediction.pieces import FEWEST, cut, split
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, MOST, Windows, make_windows, rescaled
from cjt_gym.gap.recorded.cut import Cut, cut_of
from cjt_gym.joint import Joint, JointFile, Structure
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

NARROWER, NARROWEST = (2, 4), 3
"""Divisors of the time over which states are smoothed that are tried, and fewest samples."""
WIDER, CLEARER = (2, 4, 8, 16), 0.5
"""Factors on that time that are tried with coarse angles, and ratio of the mean square errors, over
all horizons, below which one of them is taken. On two wheels with 48 steps a revolution it was 0.13
and 0.19."""
ALOUD, COARSE = ("q_m", 0.1), 0.3
"""Horizon over which the noise of the first speed, as its error grows, is compared with the motion,
and its ratio to that motion above which the angle is coarse. It was 0.9 and 1.9 on the wheels."""
SLOW = 4e-3
"""Sample time above which what drives a joint changes much from row to row [s]: the slope of its
angle is no longer its speed."""
TEST, FINE = 200, 320
"""Maximum numbers of windows on which models are compared, and from which the values of the answer
come: a breakaway torque shows in few of the windows of a search, and by them alone was found a
quarter too small."""


@dataclass(frozen=True, eq=False)
class Case:
    """Records, split into fitted and held-out parts.

    Attributes:
        joint: The nominal joint, without noise.
        logs: The records that are fitted.
        fit: Windows that are fitted.
        fine: More windows of the same pieces, from which the values of the answer come.
        test: Windows that are held out; of what is fitted if nothing is.
        all: Windows over all data for which the answer must hold.
        drive: How the current follows its command, if both were measured.
        apart: Whether the held-out windows are of records of their own.
        held: Whether any are held out.
    """

    joint: Joint
    logs: tuple[Log, ...]
    fit: Windows
    fine: Windows
    test: Windows
    all: Windows
    drive: DriveFit | None
    apart: bool = False
    held: bool = True

    @property
    def cut(self) -> Cut:
        """What cuts the joint into stages, which makes them sharper, by a torque most of all."""
        cuts = {cut_of(self.joint.structure_row, log.measured) for log in self.logs}
        if Cut.BY_TORQUE in cuts:
            return Cut.BY_TORQUE
        return Cut.NOWHERE if Cut.NOWHERE in cuts else Cut.BY_ANGLES


def make_case(
    records: Sequence[Record], held: Sequence[Record], file: JointFile, shape: Structure
) -> Case:
    """Return records ready to be judged."""
    both = to_logs([*records, *held], file, shape)
    logs, other = both[: len(records)], both[len(records) :]
    first = logs[0]
    drive = "static" if first.voltage else "current"
    if first.voltage and "v_0" not in file.parameters:
        file = _supplied(file, both)
    effects = resolve_effects(None, file, shape, drive)
    joint = quiet(Joint(file, shape.name, drive, effects), driven=first.drive != "i")
    pieces = cut(logs)
    whole = shape.output_fixed  # of which a single piece tells as much as others
    fewest = 1 if whole else FEWEST
    own, kept = (pieces, cut(other)) if other else split(logs, pieces, fewest)
    fit, fine = (make_windows(logs, own, most, whole=whole) for most in (MOST, FINE))
    tested = partial(make_windows, most=TEST, whole=whole, kept=1.0)
    test = tested(other or logs, kept or own)
    every = tested(logs, pieces) if kept and not other else test
    response = fit_drive(first, [p for p in own if p.log == 0])
    return Case(joint, tuple(logs), fit, fine, test, every, response, bool(other), bool(kept))


def sharp(case: Case, joints: Sequence[Joint], most: float = 1.0) -> Case:
    """Return a case whose predictions start from states smoothed no longer than suits the records.

    Smoothing blurs the speed where friction turns round or a spring rings, and what is not smoothed
    is noise. The width is that from which one of some joints predicts best over the shortest
    horizon. The states of a slow log, or of a spring that rings, may be those that a filter of each
    joint estimates.
    """
    if not case.logs[0].known.all():
        return case
    least = NARROWEST * max(log.dt for log in case.fit.logs)
    widths = sorted({max(SMOOTH / k, least) for k in NARROWER}, reverse=True)
    cases = [case, *(_changed(case, partial(Log.started, width=w)) for w in widths)]
    sprung = case.joint.structure_row.has_spring
    if sprung or max(log.dt for log in case.fit.logs) > SLOW:
        cases.append(_changed(case, lambda log: replace(log, filtered=True)))
    keys = [k for k, key in enumerate(case.fit.keys) if key[1] == min(HORIZONS)]
    costs = [
        min(sum(float(np.mean(one.fit.errors(joint)[k] ** 2)) for k in keys) for joint in joints)
        for one in cases
    ]
    best = int(np.argmin(costs))
    tells = costs[0] < 1.0  # joints that predict nothing tell no width
    return _calmed(cases[best] if tells and costs[best] <= most * costs[0] else case, joints)


def _calmed(case: Case, joints: Sequence[Joint]) -> Case:
    """Return a case whose predictions start from states smoothed for longer if that is far better.

    That is tried with coarse angles only: in other logs it flatters joints that are far off.
    """
    if not _is_coarse(case.fit):
        return case
    wider = [_changed(case, partial(Log.started, width=k * SMOOTH)) for k in WIDER]
    known, *others = (
        min(sum(np.log(np.mean(e**2)) for e in one.fit.errors(joint)) for joint in joints)
        for one in (case, *wider)
    )
    best = int(np.argmin(others))
    enough = len(case.fit.keys) * np.log(CLEARER)
    return wider[best] if others[best] < known + enough else case


def _is_coarse(windows: Windows) -> bool:
    """Return whether noise of the motor's angle makes much of what is predicted from its speed."""
    if ALOUD not in windows.keys:
        return False
    scale = float(np.sqrt(windows.scales[windows.keys.index(ALOUD)]))
    return float(np.median([speed_noise(log) for log in windows.logs])) * ALOUD[1] > COARSE * scale


def by_angle(case: Case) -> Case:
    """Return a case whose predictions start from the slope of the angle, not from measured speed.

    Its windows are scaled anew: from a worse start, motion at constant speed predicts less.
    """
    changed = _changed(case, Log.by_angle)
    fit, fine, test, every = (rescaled(w) for w in _windows(changed))
    return replace(changed, fit=fit, fine=fine, test=test, all=every)


def _changed(case: Case, change: Callable[[Log], Log]) -> Case:
    """Return a case with other logs."""
    logs = {id(log): change(log) for w in _windows(case) for log in w.logs}
    fit, fine, test, every = (
        replace(w, logs=tuple(logs[id(log)] for log in w.logs)) for w in _windows(case)
    )
    return replace(case, logs=fit.logs, fit=fit, fine=fine, test=test, all=every)


def _windows(case: Case) -> tuple[Windows, ...]:
    return case.fit, case.fine, case.test, case.all


def late(case: Case, rows: float) -> Case:
    """Return a case of a joint that its input moves late by some rows.

    What a current reached the log late is no delay of its drive.
    """
    fit, fine, test, every = (late_windows(windows, rows) for windows in _windows(case))
    drive, log = case.drive, fit.logs[0]
    if drive is not None:
        drive = replace(drive, delay=max(drive.delay - log.early * log.dt / log.rows, 0.0))
    return replace(case, logs=fit.logs, fit=fit, fine=fine, test=test, all=every, drive=drive)


def late_windows(windows: Windows, rows: float) -> Windows:
    """Return windows of a joint that its input moves late by some rows."""
    return replace(windows, logs=tuple(log.late(rows) for log in windows.logs))


def _supplied(file: JointFile, logs: Sequence[Log]) -> JointFile:
    """Return the joint file with the largest recorded voltage as its supply voltage."""
    most = Quantity(max(float(np.abs(log.command).max()) for log in logs), "V", "largest recorded")
    return replace(file, parameters=file.parameters.replace(v_0=most))


def as_joint(file: JointFile, case: Case) -> Joint:
    """Return the joint of a file with the structure and drive of a case, without noise."""
    like = case.joint
    effects = resolve_effects(None, file, like.structure_row, like.drive)
    joint = Joint(file, like.structure, like.drive, effects)
    return quiet(joint, driven=case.logs[0].drive != "i")
