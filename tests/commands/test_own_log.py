"""Commands on a log as a machine wrote it: other names, degrees, milliampere, before the gear."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import RecordError
from cjt_gym.joint import load_joint, load_joint_file, to_toml
from cjt_gym.records import joint_of, read_log, read_record
from cjt_gym.records.draft import draft

N = load_joint_file("orange_80_6000").gear_ratio
MAPPING = """
structure = "output_fixed_rigid_gearbox"
[columns.t]
source = "time_ms"
unit = "ms"
[columns.q_m]
source = "Motor Position"
unit = "deg"
side = "motor"
[columns.i]
source = "cur"
unit = "mA"
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of two seconds without any file beside it."""
    t = np.arange(2000) * 1e-3
    q = 0.002 * np.sin(2.0 * np.pi * 2.0 * t)
    columns = [1e3 * t, np.rad2deg(N * q), 500.0 * np.sin(2.0 * np.pi * 2.0 * t + 0.1)]
    header = "time_ms,Motor Position,cur"
    np.savetxt(
        tmp_path / "log.csv", np.column_stack(columns), delimiter=",", header=header, comments=""
    )
    return tmp_path / "log.csv"


def mapped(log: Path, head: str = "") -> None:
    log.with_suffix(".map.toml").write_text(head + MAPPING, encoding="utf-8")


def largest_angle(log: Path, capsys: pytest.CaptureFixture[str], *words: str) -> float:
    """Return the largest angle [rad] that a command sees."""
    out = log.with_name("clean.npz")
    assert main(["convert", str(log), "--out", str(out), *words]) == 0, capsys.readouterr().err
    return float(np.max(read_log(out)[0][0]["q_m"]))


@pytest.mark.parametrize("where", ["mapping", "toml", "nominal", "file"])
def test_the_gear_ratio_comes_from_the_joint_that_the_log_names(
    log: Path, capsys: pytest.CaptureFixture[str], where: str
) -> None:
    joint = to_toml(load_joint_file("orange_80_6000"))
    mapped(log, {"mapping": 'joint = "orange_80_6000"', "file": 'joint = "my.toml"'}.get(where, ""))
    if where == "toml":
        log.with_suffix(".toml").write_text('joint = "orange_80_6000"\n')
    if where in ("nominal", "file"):
        log.with_name({"file": "my.toml"}.get(where, "nominal.toml")).write_text(joint)
    assert largest_angle(log, capsys) == pytest.approx(0.002, rel=1e-6)


def test_a_joint_file_of_the_same_name_says_nothing_of_the_log(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    joint = log.with_suffix(".toml")
    text = to_toml(load_joint_file("orange_80_6000"))
    joint.write_text(f'{text}\n[sensors.i]\nnoise = {{ value = 1, unit = "mA" }}\n')
    words = ["check", str(log), "--joint", str(joint)]
    assert main(words) == 2
    assert "Columns there: time_ms" in capsys.readouterr().err
    with pytest.raises(RecordError, match="the one there is a joint file"):
        read_record(log)
    mapped(log)
    assert main(words) == 0, capsys.readouterr().err


def test_a_plot_takes_the_ratio_of_the_joint_too(log: Path) -> None:
    mapped(log, 'joint = "orange_80_6000"')
    assert main(["plot", str(log), "--out", str(log.with_suffix(".svg"))]) == 0


def test_a_joint_that_is_not_at_hand_is_asked_for(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapped(log, 'joint = "my_joint"\nn = 10')
    assert main(["diagnose", str(log)]) == 2
    assert "names the joint my_joint, which does not ship" in capsys.readouterr().err


def test_a_record_leads_to_the_joint_file_that_it_was_made_with(tmp_path: Path) -> None:
    mine, out = tmp_path / "joints" / "sea.toml", tmp_path / "records" / "run.csv"
    mine.parent.mkdir()
    mine.write_text(to_toml(load_joint_file("orange_80_6000")).replace("orange_80_6000", "sea"))
    words = ["simulate", str(mine), "--controller", "open_loop", "--duration", "0.01"]
    assert main([*words, "--out", str(out)]) == 0
    assert joint_of(out) == mine.resolve() == read_record(out).joint_file
    moved = out.with_name(mine.name)
    mine.rename(moved)
    assert joint_of(out) == moved
    moved.unlink()
    assert joint_of(out) == "sea"


def test_a_ratio_in_the_mapping_goes_before_that_of_the_joint(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapped(log, 'joint = "orange_80_6000"\nn = 10')
    assert largest_angle(log, capsys) == pytest.approx(0.0002 * N, rel=1e-6)
    capsys.readouterr()
    assert main(["check", str(log), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert any(
        note.endswith(f"by a gear ratio of 10; that of the joint is {N:g}.") for note in notes
    )


@pytest.mark.parametrize("command", ["check", "diagnose"])
def test_the_gear_ratio_comes_from_the_joint_that_is_given(
    log: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    mapped(log)
    more = [] if command == "check" else ["--validate", "nowhere.csv"]
    main([command, str(log), "--joint", "orange_80_6000", "--json", *more])
    said = capsys.readouterr()
    assert "nowhere.csv" in said.err if more else json.loads(said.out)


def test_without_a_joint_the_ratio_is_asked_for(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapped(log)
    assert joint_of(log) is None
    assert main(["check", str(log)]) == 2
    assert 'a line n = ... at the top, or joint = "..." with a joint' in capsys.readouterr().err


def test_a_log_without_a_mapping_leads_to_a_draft_that_works_once_it_is_edited(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(log)]) == 2
    hint = capsys.readouterr().err.rpartition("a draft to edit: cjt-gym ")[2].rstrip(".\n")
    assert main(hint.split()) == 0
    path = log.with_suffix(".map.toml")
    text = path.read_text(encoding="utf-8")
    assert main(["check", str(log)]) == 2
    assert "unit of columns.q_m" in capsys.readouterr().err
    assert main(hint.split()) == 2, "an edited draft is not overwritten"
    text = text.replace('unit = "?"  # rad', 'unit = "deg"  # rad')
    text = text.replace('unit = "?"  # A', 'unit = "mA"  # A').replace(
        'side = "?"', 'side = "motor"'
    )
    path.write_text('joint = "orange_80_6000"\n' + text, encoding="utf-8")
    assert largest_angle(log, capsys) == pytest.approx(0.002, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("time_ms", '[columns.t]\nsource = "time_ms"\nunit = "ms"'),
        ("motorVel [rad/s]", '[columns.dq_m]\nsource = "motorVel [rad/s]"\nunit = "rad/s"'),
        ("vel_deg_s", '[columns.dq_m]\nsource = "vel_deg_s"\nunit = "deg/s"'),
        ("joint_theta", '[columns.q_l]\nsource = "joint_theta"\nunit = "?"'),
        ("i_cmd_mA", '[columns.i_cmd]\nsource = "i_cmd_mA"\nunit = "mA"'),
        ("I_soll[mA]", '[columns.i_cmd]\nsource = "I_soll[mA]"\nunit = "mA"'),
        ("torque.ref (Nm)", '[columns.tau_ref]\nsource = "torque.ref (Nm)"\nunit = "N m"'),
        ("/knee:position", '[columns.q_m]\nsource = "/knee:position"\nunit = "?"'),
        ("fault code", '# [columns.?]\n# source = "fault code"'),
    ],
)
def test_columns_are_guessed_by_name(name: str, wanted: str) -> None:
    lines = draft("log.csv", {name: np.arange(3.0)}).splitlines()
    text = "\n".join(line.split("  # ")[0] for line in lines)
    assert wanted in text


def test_a_draft_under_another_ending_is_told_which(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", str(log), "--out", str(log.with_suffix(".draft.toml"))]) == 2
    assert "for a draft of its mapping, end in .map.toml" in capsys.readouterr().err


def test_a_column_without_numbers_is_not_taken_for_the_time() -> None:
    text = draft("log.csv", {"timestamp": np.full(3, np.nan), "pos": np.arange(3.0)})
    assert "[columns.t]" not in text
    assert 'dt = "?"' in text


def test_a_log_without_a_line_of_names_is_told_so(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log.write_text(log.read_text("utf-8").partition("\n")[2], encoding="utf-8")
    assert main(["check", str(log)]) == 2
    said = capsys.readouterr().err
    assert "must begin with a line of column names" in said
    assert "got the numbers 0.0" in said


def test_a_replayed_command_moves_the_joint_as_its_file_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "replayed.npz"
    words = ["--reference", "emps", "--controller", "none", "--duration", "3", "--out", str(out)]
    assert main(["simulate", "emps", *words]) == 0
    known = read_record("emps")
    n = len(read_record(out)["q_m"])
    joint = load_joint("emps")
    p = joint.parameters
    tau = p.k_t * p.n * known["i_cmd"][:n]
    made = joint.simulate(tau, dt=known.dt)["true_q_m"]
    assert read_record(out)["q_m"] == pytest.approx(made[:n], abs=2e-4)
    assert "hangs on it" not in capsys.readouterr().out


def test_a_load_that_is_hung_on_a_joint_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "x.csv")
    words = ["--structure", "rigid", "--duration", "0.1", "--out", out]
    assert main(["simulate", "orange_80_6000", *words]) == 0
    p = load_joint_file("orange_80_6000").parameters
    assert f"A load of I_l = {10.0 * (p.I_m + p.I_g):.4g} kg m^2" in capsys.readouterr().out


def test_a_log_that_is_replayed_takes_the_gear_ratio_of_the_joint(
    log: Path, tmp_path: Path
) -> None:
    mapping = log.with_suffix(".map.toml")
    mapping.write_text(MAPPING.replace("[columns.i]", "[columns.i_cmd]"))
    out = tmp_path / "replayed.npz"
    words = ["--reference", str(log), "--controller", "none", "--out", str(out)]
    assert main(["simulate", "orange_80_6000", *words]) == 0
    assert np.ptp(read_record(out)["q_m"]) > 0.0
