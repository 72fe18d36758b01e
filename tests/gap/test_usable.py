"""What records are refused for, and what is said of those that are poor."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError, RecordError, UnknownNameError
from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.horizons.findings.corrected_values import corrected
from cjt_gym.gap.horizons.findings.verdict import unexplained_of, verdict_of
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Draft, drafted
from cjt_gym.gap.horizons.prediction.predictable import Predictable
from cjt_gym.gap.horizons.selection.judgement import Judgement, Row
from cjt_gym.gap.horizons.torque.baseline import least_squares
from cjt_gym.gap.recorded.usable import check_one_joint, measured_only, unmeasured
from cjt_gym.joint import get_structure, to_toml
from cjt_gym.records import Record, read_record
from tests.gap.horizons.rotor import INERTIA, datasheet, record
from tests.gap.test_back_emf import motor, sheet


def written(folder: Path, name: str, inertia: float) -> Record:
    """Return a record that names a joint file beside it."""
    made = record(seconds=2.0)
    np.savez(folder / f"{name}.npz", **{n: made[n] for n in ("t", "q_m", "i")})
    units = "\n".join(f'{n} = "{u}"' for n, u in (("t", "s"), ("q_m", "rad"), ("i", "A")))
    text = f'joint = "{name}.joint.toml"\nstructure = "rigid"\n\n[units]\n{units}\n'
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    joint = to_toml(datasheet(inertia))
    (folder / f"{name}.joint.toml").write_text(joint, encoding="utf-8")
    return read_record(folder / f"{name}.npz")


def test_a_record_without_motion_is_refused_with_the_reason() -> None:
    made = motor()
    bare = Record({name: made[name] for name in ("t", "v")}, {"t": "s", "v": "V"})
    with pytest.raises(RecordError, match="must have the motor's angle"):
        diagnose(bare, sheet(0.05), "rigid")


def test_a_motor_that_moves_in_a_few_rows_is_refused() -> None:
    made = record(seconds=4.0)
    angle = np.zeros(len(made))
    angle[-12:] = 0.01 * np.arange(12.0) ** 2
    with pytest.raises(RecordError, match="within a few rows"):
        diagnose(made.with_columns({"q_m": angle}), datasheet(), "rigid")


def test_records_of_two_joints_are_not_diagnosed_together(tmp_path: Path) -> None:
    one, same, other = (
        written(tmp_path, name, x) for name, x in (("a", 2.0), ("b", 2.0), ("c", 3.0))
    )
    check_one_joint([one, same, record()])
    with pytest.raises(ConfigurationError, match="of one joint"):
        diagnose(one, validate=other)


def test_a_current_that_repeats_its_command_was_not_measured() -> None:
    made = record(seconds=4.0)
    echo = made.with_columns({"i_cmd": made["i"]}, {"i_cmd": "A"})
    exam = examine(echo, datasheet(), get_structure("rigid"))
    assert exam.faults[0].startswith("i repeats i_cmd in every row: it was not measured")
    assert "i" not in exam.channels
    rounded = echo.with_columns({"i": np.round(made["i"], 3)})
    assert unmeasured(rounded) == {"i": ("i_cmd", "repeats i_cmd in every row")}
    (kept,) = measured_only([echo])
    assert set(kept.columns) == {"t", "q_m", "i_cmd"}
    late = np.concatenate([made["i"][:1], made["i"][:-1]])
    (own,) = measured_only([echo.with_columns({"i": late})])
    assert "i" in own


def test_a_current_that_never_changes_while_its_command_does_was_not_measured() -> None:
    made = record(seconds=4.0)
    idle = made.with_columns({"i_cmd": made["i"], "i": 0.0 * made["i"]}, {"i_cmd": "A"})
    exam = examine(idle, datasheet(), get_structure("rigid"))
    assert exam.faults[0].startswith("i never changes while i_cmd does: it was not measured")
    (kept,) = measured_only([idle])
    assert set(kept.columns) == {"t", "q_m", "i_cmd"}


def test_an_unknown_structure_of_a_record_is_refused_by_check_too() -> None:
    with pytest.raises(UnknownNameError, match="rigid"):
        examine(replace(record(seconds=2.0), structure="rigit"), datasheet(), None)


def test_a_guess_that_is_corrected_is_said() -> None:
    case = make_case([record(seconds=4.0)], [], datasheet(), get_structure("rigid"))

    def said(inertia: float) -> str:
        draft = Draft(case.joint.file, case.joint.effects)
        draft.row("inertia")["I_m"] = inertia
        return corrected(Judgement(case, "found", drafted(case.joint, draft), ()))

    assert said(INERTIA).endswith("0.04 kg m^2, is corrected to 0.02.")
    assert said(0.8).endswith(
        "That is a factor of 20: check units, gear ratio and torque constant."
    )
    assert corrected(Judgement(case, "datasheet", case.joint, ())) == ""


@pytest.mark.parametrize(("nominal", "verdict"), [(0.6, "unexplained"), (0.3, "no_gap")])
def test_a_regression_that_halves_the_error_leaves_a_gap_without_a_name(
    nominal: float, verdict: str
) -> None:
    case = make_case([record(seconds=4.0)], [], datasheet(), get_structure("rigid"))
    regressed = least_squares(case.joint, case.logs)
    assert regressed is not None
    row = Row(0.5, "q_m", nominal, 0.2, 0.2, 0.2, Predictable(0.0, 0.1))
    judged = Judgement(case, "least squares", regressed, (row,))
    assert verdict_of(judged, (), suspected=False) == verdict
    said = unexplained_of(judged, verdict, ()).text
    assert re.search(r"inertia \(0\.0\d+ kg m\^2\), .* and offset \(.* N m\)", said)


@pytest.mark.slow
def test_a_log_of_which_little_was_used_says_so() -> None:
    made = record()
    kept = (made.t < 1.5) | ((1000.0 * made.t).astype(int) % 400 < 300)
    columns = {n: made[n][kept] for n in ("t", "q_m", "i")}
    broken = Record(columns, made.units, structure="rigid")
    assert "has gaps" in diagnose(broken, datasheet(), "rigid").unexplained.text
    assert "has gaps" not in diagnose(made, datasheet(), "rigid").unexplained.text


def test_a_dead_angle_beside_a_velocity_that_moves_is_refused() -> None:
    made = record(seconds=2.0)
    speed = np.gradient(made["q_m"], made.dt)
    columns = {"t": made["t"], "q_m": 0.0 * speed, "dq_m": speed, "i": made["i"]}
    units = {"t": "s", "q_m": "rad", "dq_m": "rad/s", "i": "A"}
    with pytest.raises(RecordError, match="q_m never changes, though dq_m does"):
        diagnose(Record(columns, units, structure="rigid"), datasheet())
