"""The command `cjt-gym check`: what it prints, and what it answers to bad input."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cjt_gym.cli import main
from cjt_gym.joint import JointFile, to_toml
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import write_record
from tests.gap.check.moved import ONE, columns, joint, record


@pytest.fixture
def one_way(tmp_path: Path) -> Path:
    """A record of motion in one direction, with its joint beside it."""
    (tmp_path / "nominal.toml").write_text(to_toml(joint()), encoding="utf-8")
    return write_record(record(columns(ONE)), tmp_path / "run.npz")


def test_it_prints_channels_faults_and_what_can_be_told_in_this_order(
    one_way: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(one_way)]) == 0
    said = capsys.readouterr().out
    heads = ["Channels", "Faults of the log", "Identifiable", "Not identifiable"]
    places = [said.index(head) for head in [*heads, "What to record instead"]]
    assert places == sorted(places)
    assert "Motion in one direction only" in said
    assert "- coulomb_asym, viscous_asym: 100 % of the motion is in the positive direction" in said
    assert " ".join(said.split()).count("The structure rigid has no spring.") == 1
    assert max(map(len, said.splitlines())) <= 100


def test_as_json_it_has_the_keys_of_the_contract_and_more(
    one_way: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(one_way), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"can_tell", "cannot_tell", "faults", "smallest", "advice", "channels"} <= set(found)
    assert set(found["smallest"]) == set(found["can_tell"])
    assert found["smallest"]["coulomb"]["unit"] == "N m"
    assert [channel["name"] for channel in found["channels"]] == ["i_cmd", "i", "q_m"]


def test_another_structure_is_taken(one_way: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--structure", "output_fixed_rigid_gearbox", "--json"]
    assert main(["check", str(one_way), *words]) == 0
    why = {row["name"]: row["why"] for row in json.loads(capsys.readouterr().out)["cannot_tell"]}
    assert why["stiffness"] == "The joint torque tau is not recorded."


@pytest.mark.parametrize("command", ["check", "diagnose"])
def test_a_joint_without_inertia_is_refused(
    one_way: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both commands say which value is absent, and where to add it."""
    values = {k: q.number for k, q in joint().parameters.quantities.items() if k[0] != "I"}
    for more, said in (
        ({}, r"I_m of .* is needed and absent; add I_m = "),
        ({"I_m": 0.0}, r"I_m \+ I_g \+ I_l of .* must be > 0 kg m\^2 for structure rigid"),
        ({"I_g": 0.1}, r"I_m of .* is needed and absent; add I_m = "),
        ({"I_m": 0.0, "I_g": 0.1}, r"I_m of .* must be > 0 kg m\^2, got 0"),
    ):
        bare = JointFile(JointParameters.from_values("mass", values | more), structure="rigid")
        one_way.with_name("nominal.toml").write_text(to_toml(bare), encoding="utf-8")
        assert main([command, str(one_way)]) == 2
        assert re.search(said, capsys.readouterr().err)


def test_bad_input_is_one_line_and_status_two(
    one_way: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (
        [str(one_way), "--structure", "rigdi"],
        [str(one_way), "--joint", "ornge_80_6000"],
        [str(one_way.with_name("nowhere.npz"))],
    ):
        assert main(["check", *words]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_record_without_a_joint_is_examined_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_record(record(columns()), tmp_path / "run.npz")
    assert main(["check", str(path)]) == 0
    assert "coulomb" in capsys.readouterr().out
