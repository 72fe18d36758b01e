"""Many joints from one table."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError, ParameterError
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
        again = load_joint(row["file"])
        assert (again.structure, again.drive) == (row["structure"], row["drive"])
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


def test_what_a_table_leaves_open_is_as_the_joint_file_says(tmp_path: Path) -> None:
    text = (resources.files("cjt_gym.params") / "orange_80_6000.toml").read_text(encoding="utf-8")
    head = 'structure = "rigid_gearbox"\ndrive = "rl"\n\n[parameters]'
    (tmp_path / "mine.toml").write_text(text.replace("[parameters]", head), encoding="utf-8")
    path = tmp_path / "table.toml"
    path.write_text('[joints]\na = { file = "mine.toml", parameters = { k_b = 1e4 } }\n')
    joint = build_joints(path)["a"]
    assert (joint.structure, joint.drive) == ("rigid_gearbox", "rl")
    assert joint.parameters.quantities["k_b"].source == f"set in {path}"
    path.write_text('structures = ["rigid"]\n[joints]\na = { file = "mine.toml" }\n')
    assert build_joints(path)["a-rigid"].drive == "rl"


def test_a_table_takes_parameter_files_of_the_toolbox(tmp_path: Path) -> None:
    (tmp_path / "one.m").write_text(
        "params.I_m = 0.2;\nparams.I_g = 0.1;\nparams.k_b = 1e4;\nparams.n = 80;\n"
        "params.k_t = 0.04;\nparams.I_l = 1e-4;\n"
    )
    path = tmp_path / "table.toml"
    path.write_text('structures = ["rigid_gearbox"]\n[joints]\na = { file = "one.m" }\n')
    assert build_joints(path)["a-rigid_gearbox"].parameters.k_b == 1e4


@pytest.mark.filterwarnings("always")
def test_a_command_says_once_that_an_effect_changes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "table.toml"
    path.write_text(
        'structures = ["rigid", "full_dynamics", "rigid_gearbox"]\n[joints]\norange_80_6000 = {}\n'
        "[effects]\nasym = { viscous_asym = {} }\n"
    )
    assert main(["build", str(path)]) == 0
    said = capsys.readouterr()
    assert said.err.count("changes nothing") == 1
    assert said.out.count("viscous_asym") == 3


def test_an_error_names_the_joint_of_the_table() -> None:
    table = GOOD | {"joints": {"a": FILE, "b": FILE | {"parameters": {"kb": 1.0}}}}
    with pytest.raises(ParameterError, match="b-rigid of the table: .*Did you mean 'k_b'"):
        build_joints(table)


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
    {"drives": []},
    {"structures": []},
    {"effects": ["coulomb"]},
    {"effects": {"x": 3}},
    {"effects": {"x": [3]}},
    {"effects": {"x": {"coulomb": 1}}},
]


@pytest.mark.parametrize("wrong", WRONG)
def test_tables_of_wrong_types_are_errors_of_ours(wrong: dict[str, Any]) -> None:
    with pytest.raises(CjtGymError):
        build_joints(GOOD | wrong)
