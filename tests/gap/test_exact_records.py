"""Simulated records without noise: what a new user diagnoses first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.gap import diagnose
from cjt_gym.gap.recorded.fields import nominal_fields
from cjt_gym.gap.recorded.missing import same_here
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.recorded.signals import taken_over
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Problem
from cjt_gym.joint import get_structure, load_joint_file
from cjt_gym.records import Record, read_record

JOINT, FIXED = "avocado_100_21000", "output_fixed_rigid_gearbox"


def simulated(folder: Path, reference: str, *effects: str) -> Record:
    out = folder / f"{reference}.npz"
    options = ["--controller", "open_loop", "--amplitude", "60", "--duration", "4"]
    arguments = ["simulate", JOINT, *options, "--reference", reference, "--out", str(out)]
    main([*arguments, "--effect", *effects])
    return read_record(out)


@pytest.mark.slow
def test_a_late_joint_with_friction_is_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hidden = ("coulomb.d_cm=6", "measurement_delay.delay=0.001")
    records = [simulated(tmp_path, name, *hidden) for name in ("multisine", "chirp")]
    found = diagnose(records[0], validate=records[1])
    effects = {effect.name: effect for effect in found.effects}
    assert found.verdict == "explained"
    assert effects["command_delay"].parameters["delay"].value == pytest.approx(1e-3, rel=0.02)
    assert "measurement_delay" in effects["command_delay"].confusable_with
    both = 6.0 + 3.3  # motor and gear of a rigid gearbox are one body
    assert effects["coulomb"].parameters["d_cm"].value == pytest.approx(both, rel=0.05)
    assert found.gap.after < 0.1 * found.gap.before
    replayed = found.joint.effects["command_delay"]["delay"]
    assert replayed.number == pytest.approx(1e-3, rel=0.02)  # type: ignore[union-attr]
    capsys.readouterr()


@pytest.mark.slow
def test_a_lag_is_found_that_the_free_instant_of_the_drive_hides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records = [simulated(tmp_path, r, "current_lag.bandwidth=300") for r in ("multisine", "chirp")]
    found = diagnose(records[0], validate=records[1])
    assert [effect.name for effect in found.effects] == ["current_lag"]
    assert found.effects[0].parameters["bandwidth"].value == pytest.approx(300.0, rel=0.02)
    assert found.verdict == "explained"
    capsys.readouterr()


def test_samples_that_fit_exactly_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = simulated(tmp_path, "multisine", "coulomb.d_cm=6")
    setting = make_setting(record, load_joint_file(JOINT), get_structure(FIXED))
    problem = Problem.of(Stages(setting))
    assert set(problem.counts.values()) == {len(record) - setting.settle}
    assert "measurement_delay" in same_here(setting, "command_delay")
    capsys.readouterr()


def test_a_current_that_follows_at_once_changes_gradually_with_the_delay() -> None:
    joint = load_joint_file(JOINT)
    fields = nominal_fields(joint, get_structure(FIXED)) | {"lag": 0.0}
    c = np.sin(np.arange(50.0))

    def current(delay: float) -> np.ndarray:
        older, newer, _, reach = taken_over({**fields, "delay": delay}, c, 1e-3)
        return reach * older + (1.0 - reach) * newer

    assert current(0.0) == pytest.approx(c)
    assert current(1e-3)[1:] == pytest.approx(c[:-1])
    assert current(2.5e-4)[1:] == pytest.approx(0.75 * c[1:] + 0.25 * c[:-1])
