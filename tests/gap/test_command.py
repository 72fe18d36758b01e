"""The command `cjt-gym diagnose`: three files, clear words on bad input, and what it says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.joint import load_joint, to_toml
from cjt_gym.records import Record, write_record
from tests.gap.check.moved import joint
from tests.gap.check.moved import record as moved_record
from tests.gap.simulator import nominal, simulate

FIXED = "output_fixed_rigid_gearbox"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a person has it: a nominal joint, a record of Coulomb friction, another one."""
    place = tmp_path_factory.mktemp("joint")
    (place / "nominal.toml").write_text(to_toml(nominal()), encoding="utf-8")
    write_record(simulate(friction=(1.5, 1.5)), place / "run.npz")
    write_record(simulate(seconds=2.0, seed=5, friction=(1.5, 1.5)), place / "other.csv")
    return place


def diagnosed(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    try:
        status = main(["diagnose", *words])
    except SystemExit as stop:
        status = int(stop.code or 0)
    said = capsys.readouterr()
    return status, said.out, said.err


def test_it_writes_three_files_and_says_what_it_found(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "found"
    words = [str(folder / "run.npz"), "--validate", str(folder / "other.csv"), "--out", str(out)]
    status, said, steps = diagnosed([*words, "--json"], capsys)
    assert status == 0
    found = json.loads(said)
    assert found == json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))
    assert [effect["name"] for effect in found["effects"]] == ["coulomb"]
    assert found["gap"]["held_out"]
    assert "trying" in steps
    assert "</html>" in (out / "report.html").read_text(encoding="utf-8")
    joint = load_joint(out / "joint.toml", FIXED)
    assert joint.effects["coulomb"]["d_cm"] == pytest.approx(1.5, rel=0.1)
    again = load_joint(out / "joint.toml", FIXED).file.effects["coulomb"]["d_cm"]
    assert again.low < 1.5 < again.high  # type: ignore[union-attr,operator]
    assert "run" in again.source  # type: ignore[union-attr]


@pytest.mark.slow
def test_an_excitation_of_an_earlier_diagnosis_is_removed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was made for another joint, and would be run on this one."""
    for name in ("next.npz", "next.toml", "mine.txt"):
        (tmp_path / name).write_text("")
    words = ["emps", "--out", str(tmp_path), "--seconds", "10", "--json"]
    found = json.loads(diagnosed(words, capsys)[1])
    assert found["suggestion"]["record"] is None
    assert not (tmp_path / "next.npz").exists()
    assert not (tmp_path / "next.toml").exists()
    assert (tmp_path / "mine.txt").exists()


@pytest.mark.slow
def test_without_json_it_prints_a_summary_and_the_files(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    status, said, _ = diagnosed([str(folder / "other.csv")], capsys)
    assert status == 0
    assert "coulomb" in said
    assert "diagnosis/other/report.html" in said
    assert (tmp_path / "diagnosis" / "other" / "joint.toml").is_file()


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record of PD control on a joint with friction that its file does not switch on."""
    place = tmp_path_factory.mktemp("tracked")
    words = ["simulate", "orange_80_6000", "--effect", "coulomb.d_cm=2", "--duration", "4"]
    assert main([*words, "--reference", "multisine", "--out", str(place / "pd.npz")]) == 0
    return place / "pd.npz"


@pytest.mark.slow
def test_a_record_under_control_is_replayed_and_compared_in_the_loop(
    tracked: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(tracked), "--controller", "pd_feedforward", "--controller", "open_loop"]
    status, said, _ = diagnosed([*words, "--out", str(tmp_path)], capsys)
    assert status == 0
    found = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    replay = found["closed_loop"]
    assert replay["controller"] == "pd_feedforward"
    assert replay["held_out"]
    assert replay["after"] < 0.2 * replay["before"]
    assert replay["low"] < replay["removed"] < replay["high"]
    same, other = found["performance"]
    assert (same["agent"], other["agent"]) == ("pd_feedforward", "open_loop")
    assert same["removed"] > 0.8
    assert abs(same["identified"]["rmse"] / same["recorded"]["rmse"] - 1.0) < 0.1
    assert other["recorded"] is None
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for text in ("Closed-loop replay under pd_feedforward", "Performance gap", other["note"]):
        assert text in said
        assert text in page


@pytest.mark.slow
def test_a_known_controller_is_enough_for_a_replay_in_the_loop(
    tracked: Path, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = json.loads(diagnosed([str(tracked), "--json", "--out", str(tmp_path)], capsys)[1])
    assert known["closed_loop"]["after"] < known["closed_loop"]["before"]
    assert known["performance"] == []
    words = [str(folder / "other.csv"), "--json", "--out", str(tmp_path)]
    assert json.loads(diagnosed(words, capsys)[1])["closed_loop"] is None


@pytest.mark.slow
def test_an_angle_that_was_not_recorded_is_said_to_be_derived(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nominal.toml").write_text(to_toml(nominal()), encoding="utf-8")
    record = simulate(seconds=3.0, friction=(1.5, 1.5))
    columns = {**record.columns, "q_m": np.full(len(record), np.nan)}
    empty = replace(record, columns=columns, allow_nan=True)
    write_record(empty, tmp_path / "no_angle.npz")
    status, said, _ = diagnosed(["no_angle.npz", "--out", "found"], capsys)
    assert status == 0
    assert "q_m is absent or empty" in " ".join(said.split())
    assert "q_m is absent or empty" in (tmp_path / "found" / "report.html").read_text("utf-8")


@pytest.mark.parametrize("noisy", [True, False])
def test_a_record_at_rest_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], noisy: bool
) -> None:
    """Any joint predicts rest, one that is 200 times too light as well as the true one."""
    (tmp_path / "nominal.toml").write_text(to_toml(joint()), encoding="utf-8")
    rng, count = np.random.default_rng(0), 4000
    q, i = (np.round(rng.normal(0.0, s, count) / 1e-5) * 1e-5 for s in (1e-5, 0.02))
    table = {"t": 1e-3 * np.arange(count), "i": i, "q_m": q if noisy else np.full(count, 0.3)}
    write_record(moved_record(table), tmp_path / "rest.npz")
    status, _, err = diagnosed([str(tmp_path / "rest.npz"), "--out", str(tmp_path / "out")], capsys)
    assert status == 2
    assert "nothing moves by more than its noise" in err
    assert "Record motion" in err
    assert not (tmp_path / "out" / "joint.toml").exists()


def change(folder: Path, name: str, **columns: object) -> None:
    """Write a record with columns replaced; None leaves one out."""
    record = simulate(seconds=1.0)
    changed = {n: record[n] for n in record.columns if columns.get(n, 0) is not None}
    changed |= {n: np.asarray(x, dtype=float) for n, x in columns.items() if x is not None}
    units = {n: record.units.get(n, "s") for n in changed}
    kept = Record(changed, units, dt=1e-3, structure=FIXED, allow_nan=True)
    write_record(kept, folder / name)


def broken(place: Path) -> None:
    """Fill a folder with what people hand in by mistake."""
    length = len(simulate(seconds=1.0))
    change(place, "good.csv")
    change(place, "degrees.csv", q_m=np.degrees(simulate(seconds=1.0)["q_m"]))
    change(place, "no_angle.csv", q_m=None, q_l=None, tau=None)
    change(place, "no_drive.csv", i=None, i_cmd=None)
    nothing = np.full(length, np.nan)
    change(place, "nothing_there.csv", q_m=nothing, q_l=nothing, tau=nothing)
    write_record(simulate(seconds=0.04), place / "short.csv")
    (place / "empty.csv").write_text("", encoding="utf-8")
    (place / "foreign.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    (place / "words.csv").write_text("t,q_m\n0,one\n", encoding="utf-8")
    (place / "ragged.csv").write_text("t,q_m\n0,1\n1\n", encoding="utf-8")
    (place / "fake.npz").write_bytes(b"not an archive")
    (place / "notes.txt").write_text("hello", encoding="utf-8")
    (place / "bad.toml").write_text("name = ", encoding="utf-8")
    (place / "odd.toml").write_text('name = "odd"\nsource = "x"\nspeed = 3\n', encoding="utf-8")
    (place / "poor.toml").write_text('name = "poor"\nsource = "x"\n', encoding="utf-8")
    (place / "map.toml").write_text('[columns.q_x]\nsource = "a"\n', encoding="utf-8")
    (place / "file").write_text("", encoding="utf-8")


J, S = ["--joint", "nominal.toml"], ["--structure", FIXED]
BROKEN = [
    ([], "records|RECORD"),
    (["absent.csv"], "absent.csv"),
    (["emp"], "emps"),
    (["good.csv"], "nominal"),
    (["good.csv", *J, "--structure", "rigit"], "'rigid'"),
    (["good.csv", "--joint", "orange"], "orange_80_6000"),
    (["good.csv", "--joint", "absent.toml"], "absent.toml"),
    (["good.csv", "--joint", "bad.toml"], "TOML"),
    (["good.csv", "--joint", "odd.toml"], "speed"),
    (["good.csv", "--joint", "poor.toml"], "needed and absent"),
    (["degrees.csv", *J], "180/pi"),
    (["no_angle.csv", *J], "q_m"),
    (["no_drive.csv", *J], "i_cmd"),
    (["nothing_there.csv", *J], "q_m"),
    (["short.csv", *J], "samples"),
    (["empty.csv", *J, *S], "empty.csv"),
    (["foreign.csv", *J, *S], "foreign.csv"),
    (["words.csv", *J, *S], "words.csv"),
    (["ragged.csv", *J, *S], "ragged.csv"),
    (["fake.npz", *J, *S], "fake.npz"),
    (["notes.txt", *J, *S], "notes.txt"),
    (["good.csv", *J, "--mapping", "map.toml"], "columns.q_x of map.toml"),
    (["good.csv", *J, "--mapping", "absent.toml"], "absent.toml"),
    (["good.csv", *J, "--validate", "absent.csv"], "absent.csv"),
    (["good.csv", *J, "--validate", "no_drive.csv"], "i_cmd"),
    (["good.csv", *J, "--seconds", "-1"], "seconds"),
    (["good.csv", *J, "--seconds", "long"], "seconds"),
    (["good.csv", *J, "--out", "file"], "file"),
    (["good.csv", "--join", "nominal.toml", "--deep"], "--deep"),
]


@pytest.fixture(scope="module")
def mistakes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("mistakes")
    broken(place)
    (place / "sheet").mkdir()
    (place / "sheet" / "nominal.toml").write_text(to_toml(nominal()), encoding="utf-8")
    return place


@pytest.mark.parametrize(("words", "says"), BROKEN, ids=[" ".join(w) for w, _ in BROKEN])
def test_bad_input_is_answered_by_one_line(
    words: list[str],
    says: str,
    mistakes: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(mistakes)
    words = [w.replace("nominal.toml", "sheet/nominal.toml") for w in words]
    status, said, error = diagnosed(words, capsys)
    last = [line for line in error.splitlines() if line.startswith("cjt-gym")]
    assert status == 2, error
    assert said == ""
    assert len(last) == 1
    assert any(part in last[0] for part in says.split("|")), last
    assert "Traceback" not in error


@pytest.mark.parametrize(
    ("words", "said"),
    [(["run.npz"], "given twice"), (["--validate", "run.npz"], "held out at once")],
)
def test_a_record_neither_counts_twice_nor_tests_itself(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    more = [str(folder / word) if word.endswith(".npz") else word for word in words]
    asked = [str(folder / "run.npz"), *more, "--out", str(tmp_path / "found")]
    status, _, error = diagnosed(asked, capsys)
    assert status == 2
    assert said in error
