"""Joints whose torque is not measured, but both ends of their spring."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.recorded.setting import Setting, make_setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.joint import get_structure
from tests.gap.series_elastic import FIXED, FREE, Arm, log, sheet, without

SMOOTH = Arm(d_m=0.0, dry=0.0, d_l=0.0)


def numbers(found: Diagnosis, true: dict[str, float]) -> None:
    """Assert that a diagnosis tells these numbers and no others, each within its interval."""
    known = {s: one for e in found.effects for s, one in e.parameters.items() if s in true}
    assert known.keys() == true.keys()
    for symbol, value in true.items():
        assert known[symbol].low < value < known[symbol].high, symbol
        assert known[symbol].value == pytest.approx(value, rel=0.03), symbol


def setting(folder: Path, *absent: str, structure: str = FREE) -> Setting:
    record = without(log(structure, SMOOTH), *absent)
    return make_setting(record, sheet(folder), get_structure(structure))


def test_two_angles_cut_a_joint_where_no_torque_is_measured(tmp_path: Path) -> None:
    both = setting(tmp_path, "tau")
    assert Stages(both).names == ("drive", "motor", "load")
    assert both.stages_of("transmission") == ("motor", "load")
    assert both.stages_of("drive", "load") == ("drive", "load")
    one = setting(tmp_path, "tau", "q_l")
    assert Stages(one).names == ("drive", "motor")
    assert one.stages_of("transmission", "load") == ("motor",)
    measured = setting(tmp_path)
    assert Stages(measured).names == ("drive", "motor", "transmission", "load")
    assert measured.stages_of("transmission", "load") == ("transmission", "load")
    held = setting(tmp_path, "tau", structure=FIXED)
    assert Stages(held).names == ("drive", "motor")


def test_friction_of_each_side_is_told_by_two_angles(tmp_path: Path) -> None:
    """The load's friction was told as 0.59 N m for 0.4 with 0.43 as the lowest possible."""
    arm = Arm(dry_load=0.4)
    found = diagnose(without(log(FREE, arm), "tau"), sheet(tmp_path))
    assert found.verdict == "explained"
    assert {e.status for e in found.effects} == {"confirmed"}
    numbers(found, {"d_cm": arm.dry, "d_cl": arm.dry_load, "d_m": arm.d_m, "d_l": arm.d_l})
    p = found.joint.parameters
    assert arm.load == pytest.approx(p.I_l, rel=0.01)
    assert p.d_gl == pytest.approx(arm.damping, rel=0.05)
    assert any("in proportion only" in said for said in found.unexplained.missing)


def test_fine_encoders_show_how_a_motor_moves_within_a_sample(tmp_path: Path) -> None:
    """Taken as straight from row to row, its motion looked like a spring with hysteresis."""
    arm = replace(SMOOTH, stiffness=255.0, d_l=0.05)
    found = diagnose(without(log(FREE, arm), "tau"), sheet(tmp_path))
    assert [e.name for e in found.effects] == ["damping"]
    numbers(found, {"d_l": arm.d_l})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "true"),
    [
        (Arm(dry_load=0.4, weight=3.0, dry=0.3), {"torque": 3.0, "d_cl": 0.4, "d_cm": 0.3}),
        (Arm(hard=60.0), {"k_3": 60.0 * 300.0, "d_cm": 0.8, "d_m": 0.6}),
        (Arm(cogging=0.6, step=1e-4), {"d_cm": 0.8, "d_m": 0.6, "f": 25.0, "b": -0.6}),
        (Arm(d_l=0.6, dry=0.2, step=3.8e-4), {"d_l": 0.6, "d_cm": 0.2, "d_m": 0.6}),
    ],
    ids=["weight", "hardening", "cogging", "coarse"],
)
def test_more_than_friction_is_told_by_two_angles(
    tmp_path: Path, arm: Arm, true: dict[str, float]
) -> None:
    found = diagnose(without(log(FREE, arm), "tau"), sheet(tmp_path))
    assert found.verdict == "explained"
    numbers(found, true)


def test_check_tells_what_two_angles_show(tmp_path: Path) -> None:
    record, file = without(log(FREE, Arm()), "tau"), sheet(tmp_path)
    seen = {"gear_ripple", "load_friction", "spring_hysteresis", "load_coulomb"}
    assert seen <= set(examine([record], file, get_structure(FREE)).can_tell)
    blind = examine([without(record, "q_l")], file, get_structure(FREE))
    assert not {"gear_ripple", "spring_hysteresis"} & set(blind.can_tell)
