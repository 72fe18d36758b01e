"""What a joint file says beyond its parameters: what the joint is, units, all mistakes at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.envs.arguments import complete
from cjt_gym.errors import CjtGymError, CjtGymWarning, ParameterError
from cjt_gym.joint import load_joint, load_joint_file, to_toml
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.files.units import in_usual_unit

SHEET = """
name = "mine"
source = "data sheet"
structure = "output_fixed_rigid_gearbox"
drive = "static"
[parameters]
I_m = { value = 2.3e6, unit = "g cm^2", tolerance = 0.1 }
n = { value = 100.0, unit = "-" }
k_b = { value = 104.71975511965978, unit = "N m/deg" }
k_t = { value = 41.0, unit = "mN m/A" }
r = { value = 318.0, unit = "mOhm" }
v_0 = { value = 0.048, unit = "kV" }
dq_p = { value = 60.0, unit = "rpm" }
d_cm = { value = 264.0, unit = "N cm" }
Tmp_ANom = { value = 298.15, unit = "K" }
[effects.coulomb]
dq_0 = { value = 0.1, unit = "deg/s" }
[effects.noise]
channel = "q_m"
std = { value = 0.36, unit = "arcsec", low = 0.18, high = 0.72 }
[sensors.q_m]
resolution = { value = 1e-3, unit = "deg" }
[sampling]
dt = { value = 1.0, unit = "ms" }
"""


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    path = tmp_path / "sheet.toml"
    path.write_text(SHEET, encoding="utf-8")
    return path


# --- what a joint is ----------------------------------------------------------------------------


def test_a_file_says_what_the_joint_is_and_arguments_override(sheet: Path) -> None:
    joint = load_joint(sheet)
    assert (joint.structure, joint.drive) == ("output_fixed_rigid_gearbox", "static")
    assert tuple(joint.effects) == ("coulomb", "noise")
    other = load_joint(sheet, structure="rigid", drive="current", effects=["coulomb"])
    assert (other.structure, other.drive, tuple(other.effects)) == (
        "rigid",
        "current",
        ("coulomb",),
    )
    assert load_joint(sheet, effects=[]).effects == {}


def test_an_environment_is_what_its_joint_file_says(sheet: Path) -> None:
    sheet.write_text(SHEET + "[effects.command_delay]\ndelay = { value = 2, unit = 'ms' }\n")
    scale = {"torque_amplitude": 5.0, "velocity_scale": 1.0}
    env = gymnasium.make("CJT/TorqueTracking-v0", joint=str(sheet), **scale)
    joint = env.unwrapped.episodes.settings.joint  # type: ignore[attr-defined]
    assert (joint.structure, joint.drive) == ("output_fixed_rigid_gearbox", "static")
    assert joint.effects["command_delay"]["delay"] == pytest.approx(2e-3)
    other = complete({"joint": str(sheet), "structure": "rigid"})
    assert (other["structure"], other["drive"]) == ("rigid", "static")
    usual = complete({})
    assert (usual["structure"], usual["drive"]) == ("output_fixed_rigid_gearbox", "current")


@pytest.mark.parametrize(
    ("effects", "friction"),
    [
        ("", 5.92),
        ("[effects.coulomb]\nd_cm = { value = 8.0, unit = 'N m' }", 8.0 + 3.28),
        ("[effects.coulomb_asym]\nd_cm_n = { value = 9.0, unit = 'N m' }", 9.0 + 3.28),
        (
            "[effects.stribeck]\nd_cg = { value = 7.0, unit = 'N m' }\n"
            "d_sm = { value = 1.5, unit = 'N m' }\nv_s = { value = 0.05, unit = 'rad/s' }\n"
            "[effects.presliding]\nd_cm = { value = 2.0, unit = 'N m' }\n"
            "sigma_m = { value = 900.0, unit = 'N m/rad' }",
            5.92 + 7.0 + 1.5 + 2.0,
        ),
    ],
)
def test_the_usual_amplitude_is_thrice_the_dry_friction_that_a_file_states(
    effects: str, friction: float, tmp_path: Path
) -> None:
    path = tmp_path / "dry.toml"
    file = load_joint_file("orange_80_6000")
    weak = replace(file, parameters=file.parameters.replace(i_p=1.0))
    path.write_text(f"{to_toml(weak)}\n{effects}\n", encoding="utf-8")
    env = gymnasium.make("CJT/TorqueTracking-v0", joint=str(path))
    layout = env.unwrapped.episodes.settings.layout  # type: ignore[attr-defined]
    assert layout.torque == pytest.approx(3.0 * friction)


def test_what_a_shipped_joint_merely_knows_turns_nothing_on() -> None:
    joint = load_joint("orange_80_6000")
    assert (joint.structure, joint.drive, joint.effects) == ("full_dynamics", "current", {})
    assert load_joint("emps").structure == "rigid"


def test_an_unknown_structure_names_the_file(sheet: Path) -> None:
    sheet.write_text(SHEET.replace("output_fixed_rigid_gearbox", "rigid_gear"), encoding="utf-8")
    with pytest.raises(ParameterError, match=r"structure of .*sheet.toml: .*'rigid_gearbox'\?"):
        load_joint(sheet)


def test_what_a_diagnosis_found_is_kept(sheet: Path) -> None:
    found = '[found]\nspeed = { low = -1.0, high = 1.0, unit = "rad/s" }\n'
    found += "[found.covariance]\nmatrix = [[1.0, 0.5], [0.5, 2.0]]\n"
    sheet.write_text(SHEET + found, encoding="utf-8")
    file = load_joint_file(sheet)
    assert file.found["covariance"]["matrix"] == ((1.0, 0.5), (0.5, 2.0))  # type: ignore[index]
    sheet.write_text(to_toml(file), encoding="utf-8")
    assert load_joint_file(sheet) == file


# --- units --------------------------------------------------------------------------------------


def test_any_unit_of_the_right_kind_is_converted(sheet: Path) -> None:
    file = load_joint_file(sheet)
    p = file.parameters
    close = pytest.approx
    assert (p.I_m, p.k_b, p.k_t) == (close(0.23), close(6000.0), close(0.041))
    assert (p.r, p.v_0, p.dq_p) == (close(0.318), close(48.0), close(6.283185307))
    assert (p.d_cm, p.Tmp_ANom) == (close(2.64), close(25.0))
    assert p.quantities["I_m"].unit == "kg m^2"
    assert p.quantities["I_m"].tolerance == 0.1
    joint = load_joint(sheet)
    assert joint.effects["coulomb"]["dq_0"] == close(1.745329252e-3)
    assert joint.effects["noise"]["q_m"] == close(1.745329252e-6)
    noise = file.effects["noise"]["std"]
    assert (noise.low, noise.high) == (close(8.7266463e-7), close(3.4906585e-6))  # type: ignore[union-attr]
    assert file.sensors["q_m"]["resolution"].value == close(1.745329252e-5)
    assert file.sampling["dt"].value == close(1e-3)


def test_german_words_of_angles_are_units() -> None:
    assert in_usual_unit(Quantity(180.0, "Grad"), ("rad",), "q").value == pytest.approx(np.pi)
    assert in_usual_unit(Quantity(0.5, "Umdrehungen"), ("rad",), "q").value == pytest.approx(np.pi)


def test_all_mistakes_of_a_file_are_reported_at_once(
    sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SHEET.replace('"mN m/A"', '"mN m"').replace("value = 318.0", "value = -318.0")
    text = text.replace("k_b =", "k_bb =").replace("[effects.noise]", "[effects.noises]")
    text = text.replace('unit = "ms"', "unti = 3").replace("dq_0 =", "dq0 =")
    sheet.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError) as caught:
        load_joint_file(sheet)
    assert len(caught.value.mistakes) == 6
    assert f"{sheet} has 6 mistakes" in str(caught.value)
    for part in ("k_bb", "k_t of", "r of", "noises", "dq0", "unti"):
        assert sum(part in mistake for mistake in caught.value.mistakes) >= 1, part
    assert main(["simulate", str(sheet), "--out", "x.csv"]) == 2
    assert capsys.readouterr().err.count("(6)") == 1


# --- effects ------------------------------------------------------------------------------------


def test_equal_halves_are_accepted_and_said() -> None:
    with pytest.warns(CjtGymWarning, match="viscous_asym of .*orange.* changes nothing") as said:
        joint = load_joint("orange_80_6000", "rigid", effects=["viscous_asym"])
    assert len(said) == 1
    assert joint.effects["viscous_asym"]["d_m_n"] == 0.0036


def test_an_effect_of_which_nothing_is_known_is_still_refused(sheet: Path) -> None:
    with pytest.raises(ParameterError, match="nothing is known of d_m_n"):
        load_joint(sheet, effects=["viscous_asym"])


@pytest.mark.parametrize(
    "unit", ["9**9**9**9", "9⁹⁹⁹", "(9^9)^9^9", "1/0", "N m (", "9" * 400, "m" * 1000]
)
def test_units_that_are_arithmetic_or_broken_are_refused(unit: str) -> None:
    with pytest.raises(ParameterError, match="which does not exist"):
        in_usual_unit(Quantity(1.0, unit), ("N m",), "tau")


@pytest.mark.parametrize(
    "unit", ["mN m", "kg m^2/s^2", "kg m**2 s**-2", "kg m²·s⁻²", "kg m^(2)/s²"]
)
def test_powers_of_units_are_read(unit: str) -> None:
    scale = 1e-3 if unit == "mN m" else 1.0
    assert in_usual_unit(Quantity(1.0, unit), ("N m",), "tau").value == pytest.approx(scale)


@pytest.mark.parametrize("unit", ["g cm^2", "gcm2", "gcm²", "g cm2", "gcm^2", "g*cm**2"])
def test_inertias_are_read_as_datasheets_write_them(unit: str) -> None:
    found = in_usual_unit(Quantity(1.0, unit), ("kg m^2",), "I_m")
    assert found.value == pytest.approx(1e-7)
    heavy = in_usual_unit(Quantity(1.0, unit.replace("g", "kg", 1)), ("kg m^2",), "I_m")
    assert heavy.value == pytest.approx(1e-4)


# --- what is not a joint ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"name": None}, "joint must be the name of a joint or the path of its file, got None"),
        ({"name": 3}, "joint must be the name of a joint or the path of its file, got 3"),
        ({"name": "emps", "drive": ["current"]}, "Unknown drive"),
        ({"name": "emps", "parameters": "I_m"}, "parameters must be a mapping"),
    ],
)
def test_wrong_types_are_refused_in_words(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(CjtGymError, match=words):
        load_joint(**arguments)
