"""Held-out records of another joint: what explains the fitted ones does not hold for them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.prediction.case import late, make_case
from cjt_gym.gap.horizons.prediction.model import Draft, drafted
from cjt_gym.gap.horizons.prediction.windows import relative
from cjt_gym.gap.horizons.selection.contradiction import contradicted
from cjt_gym.joint import get_structure
from tests.gap.horizons.rotor import DAMPING, DRY, INERTIA, datasheet, record, right_datasheet


@pytest.mark.parametrize(("dry", "another"), [(DRY, False), (4.0 * DRY, True)])
def test_held_out_records_of_another_joint_are_told(dry: float, another: bool) -> None:
    made = make_case([record()], [record(dry=dry, seed=1)], datasheet(), get_structure("rigid"))
    case = late(made, 0.5)
    draft = Draft(case.joint.file, {})
    draft.row("inertia").update(I_m=INERTIA, I_g=0.0)
    draft.row("damping").update(d_m=DAMPING, d_g=0.0, d_l=0.0)
    draft.row("coulomb")["d_cm"] = DRY
    draft.smooth(0.0)
    joints = {"datasheet": case.joint, "found": drafted(case.joint, draft)}
    held = {name: relative(case.test, case.test.errors(joint)) for name, joint in joints.items()}
    said = contradicted(case, joints, held)
    assert ("they may be of another joint" in said) == another


@pytest.mark.slow
def test_friction_that_only_the_fitted_record_has_is_told(tmp_path: Path) -> None:
    sheet = right_datasheet(tmp_path / "rotor.toml")
    more, less = record(seconds=8.0, dry=3.0 * DRY), record(seconds=8.0, dry=1.5 * DRY, seed=1)
    told = diagnose(more, sheet, validate=less)
    assert "coulomb" not in {e.name for e in told.effects if e.status == "confirmed"}
    asked = r"fitted records call for coulomb d_cm ([0-9.]+) N m"
    (said,) = re.findall(asked, told.unexplained.text)
    assert float(said) == pytest.approx(3.0 * DRY, rel=0.05)


@pytest.mark.slow
def test_friction_of_both_records_that_left_its_tolerance_is_confirmed(tmp_path: Path) -> None:
    sheet = right_datasheet(tmp_path / "rotor.toml")
    fitted, held = (record(seconds=8.0, dry=3.0 * DRY, seed=seed) for seed in (0, 1))
    (effect,) = diagnose(fitted, sheet, validate=held).effects
    assert (effect.name, effect.status) == ("coulomb", "confirmed")
    assert effect.parameters["d_cm"].value == pytest.approx(3.0 * DRY, rel=0.05)
    assert effect.gap_removed > 0.9
