"""What `examine` and `diagnose` take as records, joint and structure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cjt_gym.cli import main
from cjt_gym.errors import ConfigurationError, MissingFileError, RecordError, UnknownNameError
from cjt_gym.gap import Examination, diagnose, examine
from cjt_gym.joint import get_structure, load_joint, load_joint_file, to_toml
from cjt_gym.records import Record, read_log, read_record

JOINT = "emps"


@pytest.fixture(scope="module")
def emps() -> Record:
    return read_record("emps").slice(0, 2000)


@pytest.fixture(scope="module")
def found(emps: Record) -> Examination:
    return examine(emps)


def test_a_joint_may_be_named_read_loaded_or_left_to_the_record(
    emps: Record, found: Examination, tmp_path: Path
) -> None:
    path = tmp_path / "knie.toml"
    path.write_text(to_toml(load_joint_file(JOINT)), encoding="utf-8")
    for joint in (JOINT, str(path), path, load_joint(JOINT), load_joint_file(JOINT)):
        assert examine([emps], joint).smallest == found.smallest
    for structure in ("rigid", get_structure("rigid")):
        assert examine(emps, JOINT, structure).smallest == found.smallest
    unnamed = examine(replace(emps, joint=None))
    assert unnamed.smallest["coulomb"] != found.smallest["coulomb"]


def test_a_joint_or_a_structure_that_does_not_exist_is_refused(emps: Record) -> None:
    with pytest.raises(MissingFileError, match="knie.toml"):
        examine(emps, "knie.toml")
    with pytest.raises(UnknownNameError, match="'rigid'"):
        examine(emps, JOINT, "rigit")
    for of in (examine, diagnose):
        with pytest.raises(ConfigurationError, match="structure must be"):
            of(emps, JOINT, 3)  # type: ignore[arg-type]


def test_a_diagnosis_takes_a_loaded_structure(emps: Record) -> None:
    named, loaded = (diagnose(emps, structure=s) for s in ("rigid", get_structure("rigid")))
    assert named.to_dict()["effects"] == loaded.to_dict()["effects"]


def test_records_and_repairs_are_told_apart(emps: Record) -> None:
    for of in (examine, diagnose):
        with pytest.raises(ConfigurationError, match=r"records, repairs = read_log\(\.\.\.\)"):
            of(read_log("emps"))  # type: ignore[arg-type]
        with pytest.raises(ConfigurationError, match=r"records, repairs = read_log\(\.\.\.\)"):
            of(([emps], ()))  # type: ignore[arg-type]
        with pytest.raises(ConfigurationError, match="of type Record, got None"):
            of(None)  # type: ignore[arg-type]


def test_an_examination_prints_what_the_command_prints(
    capsys: pytest.CaptureFixture[str],
) -> None:
    exam = examine(read_record("emps"))
    assert main(["check", "emps"]) == 0
    assert capsys.readouterr().out.rstrip() == str(exam).rstrip()
    assert repr(exam).startswith(f"<Examination: {len(exam.can_tell)} of ")


def test_a_joint_file_that_a_log_names_and_that_is_missing_is_looked_for_in_places_that_are_told(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,pos\n" + "".join(f"{1e-2 * k:.2f},{k}\n" for k in range(100)))
    mapping = {"joint": "kni.toml", "structure": "rigid", "columns": {"t": "t", "q_m": "pos"}}
    records, _ = read_log(path, mapping)
    for of in (examine, diagnose):
        with pytest.raises(MissingFileError, match="kni.toml does not exist") as error:
            of(records)
        assert str(tmp_path / "kni.toml") in str(error.value)
    motor = {"t": "t", "q_m": {"source": "pos", "side": "motor"}}
    with pytest.raises(RecordError, match="needs the gear ratio") as refused:
        read_log(path, mapping | {"columns": motor})
    assert str(tmp_path / "kni.toml") in str(refused.value)
