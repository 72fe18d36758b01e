"""The table for Isaac Lab holds the joint's numbers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cjt_gym.cli import main
from cjt_gym.commands.export import ENDINGS
from cjt_gym.errors import ConfigurationError
from cjt_gym.export import to_isaaclab
from cjt_gym.export.isaaclab import SUPPORT, actuators
from cjt_gym.joint import EFFECTS, load_joint

FIXED = "output_fixed_rigid_gearbox"


def test_the_numbers_are_those_of_the_joint_with_its_effects() -> None:
    effects = {"coulomb_asym": {"d_cm": 3.0, "d_cm_n": 2.0, "d_cg": 0.0, "d_cg_n": 0.0}}
    table = actuators(load_joint("orange_80_6000", FIXED, effects=effects))
    motor, spring = table["motor"], table["spring"]
    assert motor["class"] == "DCMotorCfg"
    assert motor["armature"] == pytest.approx(0.23 + 0.0717)
    assert motor["friction"] == motor["dynamic_friction"] == pytest.approx(2.5)
    assert motor["effort_limit"] == pytest.approx(0.078 * 80 * 30)
    assert motor["saturation_effort"] == pytest.approx(0.078 * 80 * 48 / 0.318)
    assert spring["stiffness"] == pytest.approx(6000.0)


def test_a_compliant_gear_is_lumped_into_the_spring() -> None:
    table = actuators(load_joint("orange_80_6000", "output_fixed"))
    assert table["spring"]["stiffness"] == pytest.approx(1.0 / (1.0 / 6000.0 + 1.0 / 16000.0))


def test_a_delay_counts_physics_steps() -> None:
    joint = load_joint("orange_80_6000", FIXED, effects={"command_delay": {"delay": 0.004}})
    motor = actuators(joint, timestep=2e-3)["motor"]
    assert motor["class"] == "DelayedPDActuatorCfg"
    assert (motor["min_delay"], motor["max_delay"]) == (2, 2)


def test_a_rigid_joint_has_no_spring() -> None:
    assert set(actuators(load_joint("orange_80_6000", "rigid"))) == {"motor"}


def test_breakaway_is_the_static_friction() -> None:
    effects = {"stribeck": {"d_cm": 2.0, "d_sm": 1.5, "v_s": 0.1}}
    motor = actuators(load_joint("orange_80_6000", FIXED, effects=effects))["motor"]
    assert motor["friction"] == pytest.approx(3.5)
    assert motor["dynamic_friction"] == pytest.approx(2.0)


def test_the_table_names_rows_of_the_effect_table_and_every_effect_is_accounted_for() -> None:
    assert set(SUPPORT) <= set(EFFECTS)
    joint = load_joint("orange_80_6000", "full_dynamics", effects="all")
    found = to_isaaclab(joint)
    assert {*found.exact, *found.nearly, *found.missing} == set(joint.effects)
    assert all(name in found.text for name in found.missing)


def test_a_time_step_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="timestep of the export must be finite and > 0 s"):
        to_isaaclab(load_joint("orange_80_6000", FIXED), 0.0)


@pytest.mark.parametrize(("target", "ending"), [("mujoco", "xml"), ("isaaclab", "yml")])
def test_the_command_writes_a_file_and_says_what_is_left_out(
    target: str, ending: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / f"joint.{ending}"
    words = ["export", "orange_80_6000", "--to", target, "--effect", "coulomb", "load_friction"]
    words[-1] = "load_friction.mu_m=0.1"
    assert main([*words, "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert list(said["missing"]) == ["load_friction"]
    assert list(said["nearly"]) == ["coulomb"]
    assert "load_friction" in out.read_text(encoding="utf-8")


@pytest.mark.parametrize("target", [*ENDINGS])
def test_a_file_name_says_what_is_in_it(
    target: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = {"mujoco": "generic", "isaaclab": "generic", "c": "pd"}.get(target, "orange_residual")
    out = tmp_path / "new" / "anything.xyz"
    assert main(["export", source, "--to", target, "--out", str(out)]) == 2
    assert f"Write --out {out.with_suffix(ENDINGS[target][0])}" in capsys.readouterr().err
    assert not out.parent.exists()


def test_an_unknown_target_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["export", "orange_80_6000", "--to", "gazebo", "--out", "x"]
    monkeypatch.setattr("sys.argv", ["cjt-gym", *words])
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert "mujoco" in capsys.readouterr().err
