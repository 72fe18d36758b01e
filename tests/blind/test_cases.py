"""Whole cases: repeatable, readable, silent about what they hide, and scored by the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.blind import SMALL, draw_case, write_case
from cjt_gym.blind.excitation import DRAWN, excitation
from cjt_gym.blind.plant import STRUCTURES
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint.files.joint_file import load_joint_file
from cjt_gym.records import read_record
from tests.blind.joints import short

FILES = {"nominal.toml", "diagnose.npz", "diagnose.toml", "validate.npz", "validate.toml"}


def test_same_seed_same_case() -> None:
    one, other = draw_case(11, duration=2.0), draw_case(11, duration=2.0)
    assert one.label == other.label
    assert one.sheet == other.sheet
    for name, values in one.validate.columns.items():
        np.testing.assert_array_equal(values, other.validate.columns[name])


def test_other_seed_other_case() -> None:
    assert short(4).sheet != short(5).sheet


def test_effect_leaves_joint_and_chances_alone() -> None:
    one, other = short(), short(effect="torque_bias")
    assert one.sheet == other.sheet
    np.testing.assert_array_equal(
        one.diagnose.columns["i"][:400], other.diagnose.columns["i"][:400]
    )


def test_files_load(tmp_path: Path) -> None:
    folder = write_case(short(), tmp_path / "case_000")
    assert {path.name for path in folder.iterdir()} == FILES
    joint = load_joint_file(folder / "nominal.toml")
    assert joint.name == "case_000"
    assert joint.parameters.k_b == pytest.approx(short().sheet.values["k_b"], rel=1e-5)
    for name in ("diagnose", "validate"):
        record = read_record(folder / f"{name}.npz")
        assert record.structure == "output_fixed_rigid_gearbox"
        assert record.joint_file == folder / "nominal.toml"
        assert list(record.columns) == ["t", "i_cmd", "i", "q_m", "q_l", "tau"]


def test_files_tell_nothing(tmp_path: Path) -> None:
    """Two cases that differ in their effect alone have the same files but for the samples."""
    one = write_case(short(), tmp_path / "one" / "case")
    other = write_case(short(effect="torque_bias"), tmp_path / "other" / "case")
    for name in ("nominal.toml", "diagnose.toml", "validate.toml"):
        assert (one / name).read_bytes() == (other / name).read_bytes()


def test_a_label_is_plain_data() -> None:
    label = json.loads(json.dumps(short().label))
    assert label["effects"] == ["coulomb"]
    assert label["places"] == {"coulomb": "motor"}
    assert label["units"]["coulomb"] == {"d_cm": "N m"}


def test_true_model_is_far_nearer() -> None:
    gap = short().label["gap"]["free_run"]
    assert gap["true"]["tau"] < 0.2 * gap["stated"]["tau"]


@pytest.mark.parametrize("kind", DRAWN)
@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_excitations_begin_at_rest_and_stay_within_one(kind: str, dt: float) -> None:
    signal = excitation(kind, round(4.0 / dt), dt, np.random.default_rng(1))
    assert np.all(signal[: round(0.5 / dt)] == 0.0)
    assert 0.3 < np.abs(signal).max() <= 1.0


def test_noise_is_as_stated() -> None:
    """At rest the spread of a channel is its stated noise and rounding."""
    case = short()
    still = slice(0, 450)
    for j, channel in ((0, "i"), (1, "q_m"), (4, "tau")):
        step, std = case.sheet.resolution[j], case.sheet.noise[j]
        spread = np.diff(case.diagnose.columns[channel][still], 3).std() / np.sqrt(20.0)
        assert spread == pytest.approx(np.hypot(std, step / np.sqrt(12.0)), rel=0.35)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_closed_loop_follows_its_reference(structure: str) -> None:
    """The loop neither lives at its limits nor swings up, whatever the joint."""
    case = draw_case(
        8, effects=[], structure=structure, excitation="steps", closed_loop=True, duration=2.0
    )
    command = case.diagnose.columns["i_cmd"]
    assert np.mean(np.abs(command) >= case.sheet.i_p) < 0.02
    assert case.diagnose.mode == "closed loop"
    assert case.label["gap"]["free_run"]["true"]["tau"] < 0.05


def test_small_effects_are_a_tenth() -> None:
    whole = short().label["parameters"]["coulomb"]["d_cm"]
    small = short(strength=SMALL).label["parameters"]["coulomb"]["d_cm"]
    assert small == pytest.approx(0.1 * whole)


def test_mistakes_are_named() -> None:
    with pytest.raises(UnknownNameError, match="coulomb"):
        draw_case(0, effects=["colomb"])
    with pytest.raises(ConfigurationError, match="backlash"):
        draw_case(0, effects=["backlash"], structure="rigid")
    with pytest.raises(ConfigurationError, match="together"):
        draw_case(0, effects=["gravity:", "gear_stiffness", "coulomb:moon"])
    with pytest.raises(ConfigurationError, match="duration"):
        draw_case(0, duration=0.1)
