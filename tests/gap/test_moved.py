"""Values of the datasheet that a diagnosis moves beside the effects that it names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.diagnosis import NamedEffect
from cjt_gym.gap.horizons.findings.answer import _as_sure_as_datasheet
from cjt_gym.gap.recorded.listed import as_values
from cjt_gym.gap.recorded.moved import moved_symbols, strain
from cjt_gym.gap.report.words import verdict_sentence
from cjt_gym.joint import JointFile, Quantity, get_structure
from tests.gap.horizons.rotor import DRY, INERTIA, datasheet, record, right_datasheet


@pytest.fixture
def sheet(tmp_path: Path) -> JointFile:
    return replace(right_datasheet(tmp_path / "rotor.toml"), structure="rigid")


def moved(file: JointFile, **factors: float) -> JointFile:
    """Return a joint with other values of the datasheet, each known to a hundredth."""
    known = file.parameters.quantities
    values = {
        s: replace(known[s], value=x * known[s].number, tolerance=0.01) for s, x in factors.items()
    }
    return replace(file, parameters=file.parameters.replace(**values))


def test_a_value_beyond_its_tolerance_is_told_unless_an_effect_tells_it(sheet: JointFile) -> None:
    found = moved(sheet, k_t=1.06, I_m=1.04)
    assert moved_symbols(sheet, found, ()) == ("k_t",)
    assert moved_symbols(sheet, found, {"k_t"}) == ()
    listed = {"coulomb": {**sheet.effects["coulomb"], "d_cm": Quantity(0.2, "N m", "found")}}
    assert moved_symbols(sheet, replace(sheet, effects=listed), ()) == ("d_cm",)


def test_inertias_of_one_mass_count_together(sheet: JointFile) -> None:
    known = sheet.parameters.quantities
    half = 0.5 * known["I_m"].number
    shared = sheet.parameters.replace(
        I_m=replace(known["I_m"], value=half), I_l=replace(known["I_l"], value=half)
    )
    assert moved_symbols(sheet, replace(sheet, parameters=shared), ()) == ()


def test_several_values_that_leave_their_tolerances_make_intervals_wider(sheet: JointFile) -> None:
    assert strain(sheet, moved(sheet, k_t=1.01, I_m=1.03), ()) == 1.0
    assert strain(sheet, moved(sheet, k_t=1.06), ()) == 1.0, "a single value may be off"
    found = moved(sheet, k_t=1.06, I_m=1.15)
    assert strain(sheet, found, ()) == pytest.approx(2.9, abs=0.1)
    told = replace(diagnose(record(), sheet), joint=found, effects=())
    wider = _as_sure_as_datasheet(told, sheet, felt=False).joint.parameters.quantities
    assert wider["k_t"].tolerance == pytest.approx(0.029, abs=0.001)
    assert wider["d_m"] == sheet.parameters.quantities["d_m"]


def test_a_spring_may_then_be_a_wrong_scale_of_its_sensor(sheet: JointFile) -> None:
    sure = NamedEffect("stiffness", "transmission", None, None, {}, "confirmed", 0.98, 0.9)
    told = replace(diagnose(record(), sheet), effects=(sure,))
    strained = replace(told, joint=moved(sheet, k_t=1.06, I_m=1.15))
    (doubted,) = _as_sure_as_datasheet(strained, sheet, felt=True).effects
    assert (doubted.status, doubted.confusable_with) == ("tentative", ("torque_gain",))
    for one, felt in ((strained, False), (told, True)):
        assert _as_sure_as_datasheet(one, sheet, felt=felt).effects == (sure,)


def test_a_verdict_does_not_credit_a_name_with_what_other_values_do() -> None:
    found = diagnose(record(), datasheet(2.0))
    assert found.moved == ("I_m",)
    assert "with other values of I_m," in verdict_sentence(found)
    assert "other values" not in verdict_sentence(replace(found, moved=()))
    many = verdict_sentence(replace(found, moved=("k_t", "k_b", "I_m", "I_l", "d_l")))
    assert "with other values of k_t, k_b, I_m and others," in many


def test_a_joint_whose_inertia_was_found_is_diagnosed_again(sheet: JointFile) -> None:
    row = {"I_m": Quantity(INERTIA, "kg m^2", "found", low=0.95 * INERTIA, high=1.05 * INERTIA)}
    table = {"names": ("inertia.I_m",), "values": (INERTIA,), "matrix": ((1e-6,),)}
    found = replace(sheet, effects={**sheet.effects, "inertia": row}, found={"covariance": table})
    assert not as_values(found, get_structure("rigid")).found
    again = diagnose(record(seed=1), found)
    assert again.verdict == "no_gap"
    assert not again.effects


def test_a_guess_beside_a_listed_value_is_no_value_to_correct(sheet: JointFile) -> None:
    guess = Quantity(0.5 * DRY, "N m", "guess", guess=True)
    found = replace(sheet, parameters=sheet.parameters.replace(d_cm=guess))
    again = diagnose(record(seed=1), found)
    assert "guess of d_cm" not in again.unexplained.text
    assert "d_cm" not in again.moved
