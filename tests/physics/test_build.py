"""Many joints from one table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError
from cjt_gym.joint import load_joint
from cjt_gym.joint.build import build_joints

TABLE = """
structures = ["rigid_gearbox", "output_fixed_rigid_gearbox"]

[joints]
plain = { file = "orange_80_6000" }
stiff = { file = "orange_80_6000", parameters = { k_b = 12000.0 } }

[effects]
smooth = {}
rough = { coulomb = { dq_0 = 0.002 }, cogging = { f = [480.0], a = [0.5], b = [0.2] } }
"""


def test_a_table_is_the_product_of_its_parts(tmp_path: Path) -> None:
    path = tmp_path / "table.toml"
    path.write_text(TABLE, encoding="utf-8")
    joints = build_joints(path)
    assert len(joints) == 8
    joint = joints["stiff-rigid_gearbox-rough"]
    assert (joint.parameters.k_b, joint.structure) == (12000.0, "rigid_gearbox")
    assert tuple(joint.effects) == ("coulomb", "cogging")
    assert joint.file.name == "stiff-rigid_gearbox-rough"
    assert joints["plain-rigid_gearbox-smooth"].effects == {}


def test_written_joints_are_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.toml"
    path.write_text(TABLE, encoding="utf-8")
    assert main(["build", str(path), "--out", str(tmp_path / "made"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["joints"]
    assert len(rows) == len(list((tmp_path / "made").iterdir())) == 8
    built = build_joints(path)
    for row in rows:
        again = load_joint(row["file"], row["structure"], row["drive"])
        assert again.effects == built[row["name"]].effects
        assert again.parameters == built[row["name"]].parameters
    kept = Path(rows[0]["file"])
    words = ["build", str(path), "--out", str(tmp_path / "made")]
    assert main(words) == 0  # the same again
    kept.write_text(kept.read_text() + "# mine\n")
    assert main(words) == 2
    assert "differs from what the table says" in capsys.readouterr().err
    assert kept.read_text().endswith("# mine\n")


def test_drives_are_named_where_there_are_several() -> None:
    joints = {"a": {"file": "lemon_50_6000"}}
    table = {"joints": joints, "structures": ["rigid"], "drives": ["static", "rl"]}
    assert list(build_joints(table)) == ["a-rigid-static", "a-rigid-rl"]


def test_mistakes_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Did you mean 'structures'"):
        build_joints({"joints": {}, "structure": []})
    with pytest.raises(ConfigurationError, match="must have 'joints'"):
        build_joints({"structures": ["rigid"]})
    with pytest.raises(ConfigurationError, match="unknown key 'fil'"):
        build_joints({"joints": {"a": {"fil": "x"}}, "structures": ["rigid"]})
    with pytest.raises(MissingFileError, match="does not exist"):
        build_joints(tmp_path / "none.toml")


FILE: dict[str, Any] = {"file": "orange_80_6000"}
GOOD: dict[str, Any] = {"joints": {"a": FILE}, "structures": ["rigid"]}
WRONG: list[dict[str, Any]] = [
    {"joints": [1]},
    {"joints": {"a": {"file": 3}}},
    *(
        {"joints": {"a": FILE | {"parameters": given}}}
        for given in (3, {"k_b": ""}, {"k_b": [1.0]})
    ),
    {"joints": {"a": FILE | {"parameters": {"self": 1.0}}}},
    {"structures": "rigid"},
    {"structures": [1]},
    {"drives": 3},
    {"effects": ["coulomb"]},
    {"effects": {"x": 3}},
    {"effects": {"x": [3]}},
    {"effects": {"x": {"coulomb": 1}}},
]


@pytest.mark.parametrize("wrong", WRONG)
def test_tables_of_wrong_types_are_errors_of_ours(wrong: dict[str, Any]) -> None:
    with pytest.raises(CjtGymError):
        build_joints(GOOD | wrong)
