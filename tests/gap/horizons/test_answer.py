"""What a diagnosis tells of the answer of a judgement beside what its stages found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.diagnosis import Interval, NamedEffect, StageGap
from cjt_gym.gap.horizons.findings.answer import _with_elsewhere
from cjt_gym.gap.horizons.findings.as_diagnosis import marked, without_late_drive
from cjt_gym.gap.horizons.findings.corrected_values import gave_way
from cjt_gym.gap.horizons.findings.late_drive import with_late_drive
from cjt_gym.gap.horizons.findings.not_confirmed import allowed_by
from cjt_gym.gap.horizons.findings.stages_kept import (
    _may_be_another,
    _with_stated_value,
)
from cjt_gym.gap.horizons.prediction.case import Case, as_joint, make_case
from cjt_gym.gap.horizons.prediction.drive import DriveFit
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.gap.horizons.prediction.predictable import Predictable
from cjt_gym.gap.horizons.selection.judgement import Judgement, Row
from cjt_gym.joint import get_structure, load_joint
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DAMPING, INERTIA, datasheet, record, right_datasheet

RIGID = get_structure("rigid")


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case([record()], [], datasheet(), RIGID)


@pytest.fixture(scope="module")
def told() -> Diagnosis:
    return diagnose(record(), datasheet(), "rigid")


def test_a_late_drive_is_told_beside_what_its_stage_leaves(case: Case, told: Diagnosis) -> None:
    late = DriveFit(4e-3, 0.0, 1.0, 0.3, 5e-4, 1.0)
    found = Judgement(replace(case, drive=late), "stages", case.joint, ())
    open_ = replace(told, unexplained=replace(told.unexplained, stage="drive"))
    (delay,) = (e for e in with_late_drive(open_, found).effects if e.name == "command_delay")
    assert delay.status == "tentative"
    assert delay.parameters["delay"].value == 4e-3
    assert with_late_drive(told, found).effects == told.effects


@pytest.mark.parametrize(("steps", "alike"), [(False, True), (True, False)])
def test_a_command_without_steps_does_not_tell_a_delay_from_a_lag(steps: bool, alike: bool) -> None:
    """Both are 4 ms late; only what follows a step shows which."""
    lag = {"current_lag": {"bandwidth": 40.0}}
    arm = quiet(load_joint("orange_80_6000", "rigid", effects=lag), driven=True)
    t = 1e-3 * np.arange(6000)
    command = 8.0 * np.sin(2.0 * np.pi * 0.7 * t)
    command = 4.0 * np.sign(np.sin(40.0 * t) + np.sin(23.0 * t)) if steps else command
    made = arm.simulate(command * arm.parameters.k_t * arm.parameters.n, dt=1e-3)
    columns = {"t": t, "i_cmd": command, "q_m": made["true_q_m"]}
    log = Record(columns, {"t": "s", "i_cmd": "A", "q_m": "rad"}, structure="rigid")
    late = {"current_lag": {"bandwidth": Quantity(40.0, "Hz", "the truth")}}
    case = make_case([log], [], arm.file, RIGID)
    found = Judgement(case, "stages", as_joint(replace(arm.file, effects=late), case), ())
    assert _may_be_another(found, "current_lag") == alike


def test_a_coarse_sensor_is_told_beside_a_stage_that_stays_unexplained(told: Diagnosis) -> None:
    """What shakes a stage may scatter a channel as noise does, but puts it on no lattice."""
    step = {"resolution": Interval(1e-3, 1e-3, 1e-3, "rad")}
    coarse, noisy = (
        NamedEffect(name, "sensing", None, "q_m", step, "confirmed", 0.9, 0.1, (), 1.0)
        for name in ("quantization", "noise")
    )
    first = replace(told, verdict="partly_explained", effects=(coarse, noisy))
    text = "No cause is named; refined values predict better: damping 2 for 1."
    silent = replace(told, verdict="no_gap", effects=())
    silent = replace(silent, unexplained=replace(told.unexplained, text=text))
    found = _with_elsewhere(silent, first, measured=True)
    assert [(e.name, e.status) for e in found.effects] == [("quantization", "tentative")]
    assert found.verdict == "explained"
    assert found.unexplained.text == "Refined values predict better: damping 2 for 1."
    sure = replace(first, verdict="explained")
    settled = _with_elsewhere(silent, sure, measured=True)
    assert [e.name for e in settled.effects] == ["quantization", "noise"]


def test_noise_explains_no_part_of_a_motion_that_nothing_explains(told: Diagnosis) -> None:
    size = {"noise": Interval(0.03, 0.02, 0.04, "A")}
    noisy = NamedEffect("noise", "sensing", None, "i", size, "confirmed", 0.9, 0.1, (), 1.0)
    first = replace(told, verdict="partly_explained", effects=(noisy,))
    silent = replace(told, verdict="unexplained", effects=())
    assert _with_elsewhere(silent, first, measured=True) == silent
    sure = replace(first, verdict="explained")  # nothing else may have scattered the current
    found = _with_elsewhere(silent, sure, measured=True)
    assert (found.verdict, found.effects[0].status) == ("partly_explained", "confirmed")


def test_an_explained_gap_is_none_of_a_drive_that_explains_nothing(told: Diagnosis) -> None:
    stages = {name: StageGap(2.0, 1.9, True) for name in ("drive", "motor")}
    for verdict, effects, gaps in (
        ("explained", told.effects, ["motor"]),
        ("explained", [replace(told.effects[0], stage="drive")], ["drive", "motor"]),
        ("partly_explained", told.effects, ["drive", "motor"]),
        ("no_gap", (), []),
    ):
        found = marked(stages, verdict, effects)
        assert [name for name, gap in found.items() if gap.significant] == gaps


@pytest.mark.parametrize(
    ("after", "measured", "named"), [(1.0, True, True), (5.0, True, False), (1.0, False, False)]
)
def test_a_drive_that_is_explained_is_told_whatever_the_motion_says(
    after: float, measured: bool, named: bool, told: Diagnosis
) -> None:
    limit = {"i_p": Interval(5.9, 5.8, 6.0, "A")}
    row = ("current_saturation", "drive", None, None, limit, "tentative", 0.5, 0.1, (), 1.0)
    stages = {**told.stages, "drive": StageGap(100.0, after, True)}
    first = replace(told, verdict="partly_explained", effects=(NamedEffect(*row),), stages=stages)
    silent = replace(told, verdict="no_gap", effects=())
    found = _with_elsewhere(silent, first, measured=measured)
    assert [e.name for e in found.effects] == (["current_saturation"] if named else [])


def test_a_current_that_is_clipped_is_no_late_one(told: Diagnosis) -> None:
    def of_drive(name: str, status: str) -> NamedEffect:
        number = {"x": Interval(1.0, 0.9, 1.1, "A")}
        return NamedEffect(name, "drive", None, None, number, status, 0.5, 0.1, (), 1.0)

    stages = {**told.stages, "drive": StageGap(100.0, 1.0, True)}
    late = replace(told, effects=(*told.effects, of_drive("command_delay", "tentative")))
    clipped = replace(told, effects=(of_drive("current_saturation", "confirmed"),), stages=stages)
    found = _with_elsewhere(late, clipped, measured=True)
    assert [e.name for e in found.effects] == [
        "current_saturation", *(e.name for e in told.effects)
    ]  # fmt: skip
    silent = replace(told, effects=(), stages=stages)
    assert _with_elsewhere(late, silent, measured=True).effects == late.effects


@pytest.mark.parametrize(
    ("drive", "kept"),
    [
        (StageGap(0.3, 0.3, False), False),
        (StageGap(1.5, 1.5, True), True),
        (StageGap(0.0, 0.0, False), True),
    ],
)
def test_a_drive_that_its_stage_finds_quiet_is_not_late(
    told: Diagnosis, drive: StageGap, kept: bool
) -> None:
    number = {"delay": Interval(4e-3, 3e-3, 5e-3, "s")}
    late = NamedEffect(
        "command_delay", "drive", None, None, number, "tentative", 0.5, 0.1, (), 1.0
    )  # fmt: skip
    expected = (*told.effects, late) if kept else told.effects
    assert without_late_drive((*told.effects, late), drive) == expected


@pytest.mark.parametrize("status", ["tentative", "confirmed"])
def test_damping_is_as_sure_as_that_of_the_other_direction(told: Diagnosis, status: str) -> None:
    back = {"d_m_n": Interval(245.0, 222.0, 268.0, "N m s/rad")}
    ahead = {"d_m": Interval(161.0, 146.0, 177.0, "N m s/rad")}
    effects = (
        NamedEffect("damping", "motor", "motor", None, ahead, "confirmed", 0.9, 0.9, (), 1.0),
        NamedEffect("viscous_asym", "motor", "motor", None, back, status, 0.9, 0.9, (), 1.0),
    )
    found = allowed_by(replace(told, effects=effects), {}).effects
    assert [effect.status for effect in found] == [status, status]


@pytest.mark.slow
def test_a_joint_at_rest_is_refused_unless_its_drive_has_a_gap() -> None:
    t = 1e-3 * np.arange(4000)
    command = np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 80), 50)
    units = {"t": "s", "i_cmd": "A", "i": "A", "q_m": "rad"}
    noise = np.random.default_rng(2).normal(0.0, 1e-3, len(t))
    for rows, refused in ((0, True), (9, False)):
        columns = {"t": t, "i_cmd": command, "i": np.roll(command, rows) + noise}
        made = Record({**columns, "q_m": np.zeros(len(t))}, units, structure="rigid")
        if refused:
            with pytest.raises(RecordError, match="nothing moves by more than its noise"):
                diagnose(made, datasheet(1.0, tolerance=0.1))
        else:
            found = diagnose(made, datasheet(1.0, tolerance=0.1))
            assert {e.stage for e in found.effects} == {"drive"}
            assert found.joint.parameters.I_m == pytest.approx(INERTIA)


@pytest.mark.slow
def test_a_delay_before_a_measured_current_is_confirmed_by_the_drive_alone() -> None:
    made = record(12.0, dry=0.0)
    file = datasheet(1.0, tolerance=0.1)
    file = replace(file, parameters=file.parameters.replace(d_m=DAMPING))
    ahead = np.concatenate([made["i"][3:], np.zeros(3)])
    noise = np.random.default_rng(2).normal(0.0, 1e-3, len(made.t))
    columns = {"t": made.t, "i_cmd": ahead, "i": made["i"] + noise, "q_m": made["q_m"]}
    units = {"t": "s", "i_cmd": "A", "i": "A", "q_m": "rad"}
    found = diagnose(Record(columns, units, structure="rigid"), file)
    assert found.verdict == "explained"
    (late,) = found.effects
    assert (late.name, late.status) == ("command_delay", "confirmed")


def test_a_stated_value_that_gives_way_is_told(case: Case) -> None:
    stated, shape = datasheet(1.0, tolerance=0.05), get_structure("rigid")
    heavy = replace(stated, parameters=stated.parameters.replace(I_m=1.3 * INERTIA))
    file, heavier = (make_case([record(2.0)], [], one, shape).joint for one in (stated, heavy))
    judged: Any = SimpleNamespace(case=SimpleNamespace(joint=file), joint=heavier)
    assert "I_m = 0.026 kg m^2 for 0.02 within 5 %" in gave_way(judged, ())
    judged.joint = file
    assert gave_way(judged, ()) == ""


@pytest.mark.parametrize(("error", "named"), [(0.05, True), (0.09, False)])
def test_the_stated_value_that_the_stages_refined_far_is_named_where_nothing_predicts_better(
    error: float, named: bool, case: Case, told: Diagnosis, tmp_path: Path
) -> None:
    sheet = right_datasheet(tmp_path / "rotor.toml")
    bare = {name: x.number for name, x in sheet.parameters.quantities.items()}
    other = replace(sheet, parameters=JointParameters.from_values("rotor", bare | {"k_t": 1.2}))
    nominal, strong = (Joint(one, "rigid", "current", {}) for one in (sheet, other))
    rows = (Row(0.5, "q_m", 0.6, None, error, 0.045, Predictable(0.2, 0.1)),)
    found = Judgement(replace(case, joint=nominal), "stages", strong, rows)
    first = replace(told, verdict="unexplained", effects=())
    ended = _with_stated_value(first, found)
    assert [(e.name, e.status) for e in ended.effects] == [("torque_constant", "tentative")] * named
    assert ended.verdict == ("explained" if named else "unexplained")
    if named:
        assert ended.effects[0].parameters["k_t"].value == pytest.approx(1.2)
        assert (
            _with_stated_value(replace(ended, verdict="unexplained"), found).effects
            == ended.effects
        )


@pytest.mark.parametrize(("least", "status"), [(0.0, "tentative"), (0.1, "confirmed")])
def test_friction_that_may_fall_to_nothing_is_not_confirmed(
    told: Diagnosis, least: float, status: str
) -> None:
    """Drag that grows with the square of the speed, beside dry friction, looks like it."""
    numbers = {
        "d_cm": Interval(0.3, least, 0.6, "N m"),
        "d_sm": Interval(0.5, 0.1, 0.9, "N m"),
        "v_s": Interval(0.5, 0.3, 0.8, "rad/s"),
    }
    drag = {"d_m": Interval(2.1, 1.4, 2.9, "N m s/rad")}
    laws = (("stribeck", numbers), ("damping", drag))
    effects = tuple(
        NamedEffect(name, "motor", "motor", None, n, "confirmed", 0.9, 0.2, (), 1.0)
        for name, n in laws
    )
    found = allowed_by(replace(told, effects=effects), {}).effects
    assert {effect.status for effect in found} == {status}
