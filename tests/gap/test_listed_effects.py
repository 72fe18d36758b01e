"""What a joint file lists is part of its nominal model: a diagnosis finds only what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.recorded.listed import LISTED, UNSEEN, as_values
from cjt_gym.gap.recorded.series import stretches
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.gap.stages.explain import without_effects
from cjt_gym.joint import EFFECTS, Joint, JointFile
from tests.gap.bench import STRUCTURE, joint_of, record_of

Values = Mapping[str, float]
DRY = {"d_cm": 2.0, "dq_0": 0.0}
VALUES: Mapping[str, Values] = {
    "command_delay": {"delay": 2e-3},
    "current_lag": {"bandwidth": 40.0},
    "current_rate_limit": {"rate": 300.0},
    "command_quantization": {"resolution": 0.3},
    "thermal_derating": {
        "derating": 0.002, "r": 0.6, "r_th1": 20.0, "r_th2": 1.0, "T_thw": 2.0, "T_thm": 1e4,
        "a_CU": 0.0,
    },
    "torque_offset": {"torque": 1.5},
    "coulomb": DRY,
    "coulomb_asym": {"d_cm": 2.0, "d_cm_n": 4.0, "dq_0": 0.0},
    "viscous_asym": {"d_m_n": 9.0},
    "stribeck": {"d_cm": 2.0, "d_sm": 2.0, "v_s": 0.1, "dq_0": 0.0},
    "presliding": {"d_cm": 2.0, "sigma_m": 300.0},
    "load_friction": {"mu_m": 0.2, "dq_0": 0.0},
    "cogging": {"f": 20.0, "a": 1.0, "b": -2.0},
    "gear_ripple": {"f": 20.0, "a": 0.1, "b": 0.1},
    "backlash": {"gap": 0.01},
    "hardening": {"k_3": 3e5},
    "spring_hysteresis": {"tau_h": 2.0, "delta_h": 5e-3},
    "torque_gain": {"gain": 1.2},
    "torque_bias": {"bias": 1.0},
    "torque_delay": {"delay": 3e-3},
    "load_coulomb": {"d_cl": 2.0, "dq_0": 0.0},
    "gravity": {"torque": 6.0, "angle": 0.7},
}  # fmt: skip
MOST, LEAST = 1.5, 3.0
"""Residuals of all stages and deviations from the datasheet where an effect is listed, and of some
stage or value where it is not."""


def listing(name: str, values: Values, **more: str) -> str:
    """Return the lines of a joint file that list an effect."""
    lines = [f"[effects.{name}]"]
    for symbol, value in values.items():
        parameter = EFFECTS[name].parameter(symbol)
        assert parameter is not None
        number = f"[{value!r}]" if parameter.series else repr(value)
        lines.append(f'{symbol} = {{ value = {number}, unit = "{parameter.unit}" }}')
    return "\n".join([*lines, *(f"{key} = {text}" for key, text in more.items())]) + "\n"


def test_every_effect_that_the_fields_hold_is_tried() -> None:
    assert VALUES.keys() == LISTED.keys()
    assert not LISTED.keys() & UNSEEN


def _worst(true: Joint, file: JointFile) -> float:
    """Return the largest residual, or deviation from the datasheet, of a record of a joint."""
    (stretch,) = stretches([record_of(true)])
    setting = make_setting(stretch.record, file, true.structure_row, None, stretch.log)
    problem, fit = without_effects(setting, ())
    told = {*file.parameters.quantities, "tau_0"}
    off = [abs(z) for n, z in zip(problem.shared, fit.z, strict=False) if n.field in told]
    return float(max(max(fit.mean_square.values()) ** 0.5, *off))


@pytest.mark.parametrize("name", VALUES)
def test_the_stages_know_it(tmp_path: Path, name: str) -> None:
    bare = joint_of(tmp_path)
    sheet = joint_of(tmp_path, listing(name, VALUES[name]))
    assert _worst(sheet, sheet.file) < MOST
    assert _worst(sheet, bare.file) > LEAST


@pytest.mark.parametrize("name", ["stribeck", "presliding", "cogging", "gravity", "load_coulomb"])
def test_the_stages_know_it_of_a_single_mass(tmp_path: Path, name: str) -> None:
    sheet = joint_of(tmp_path, listing(name, VALUES[name]), "rigid")
    assert _worst(sheet, sheet.file) < MOST


@pytest.mark.parametrize("name", ["load_friction", "gear_ripple"])
def test_the_stages_leave_out_what_needs_a_torque_that_is_not_measured(
    tmp_path: Path, name: str
) -> None:
    sheet = joint_of(tmp_path, listing(name, VALUES[name]), "rigid")
    with pytest.raises(ValueError, match=name):
        _worst(sheet, sheet.file)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "structure"),
    [
        (("gravity", "stribeck"), STRUCTURE),
        (("torque_gain", "hardening"), STRUCTURE),
        (("torque_bias", "coulomb"), "output_fixed_rigid_gearbox"),
    ],
)
def test_a_joint_as_listed_has_no_gap(
    tmp_path: Path, names: tuple[str, ...], structure: str
) -> None:
    rows = "".join(listing(name, VALUES[name]) for name in names)
    sheet = joint_of(tmp_path, rows, structure)
    found = diagnose(record_of(sheet), sheet.file, structure)
    assert (found.verdict, found.effects) == ("no_gap", ())


@pytest.mark.slow
def test_what_is_missing_beside_it_is_found(tmp_path: Path) -> None:
    known, missing = listing("gravity", VALUES["gravity"]), listing("load_coulomb", {"d_cl": 2.0})
    true, sheet = joint_of(tmp_path, known + missing), joint_of(tmp_path, known)
    found = diagnose(record_of(true), sheet.file, STRUCTURE)
    assert [e.name for e in found.effects] == ["load_coulomb"]
    assert found.joint.effects["gravity"] == sheet.file.effects["gravity"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "less", "structure"),
    [
        ("gravity", {"torque": 4.0}, STRUCTURE),
        ("stribeck", {"d_sm": 1.2}, STRUCTURE),
        ("cogging", {"a": 0.5, "b": -1.0}, "output_fixed_rigid_gearbox"),
    ],
)
def test_an_effect_that_is_listed_too_small_is_told_as_a_whole(
    tmp_path: Path, name: str, less: Values, structure: str
) -> None:
    true = joint_of(tmp_path, listing(name, VALUES[name]), structure)
    sheet = joint_of(tmp_path, listing(name, {**VALUES[name], **less}), structure)
    found = diagnose(record_of(true), sheet.file, structure)
    assert [e.name for e in found.effects] == [name]
    for number in found.effects[0].parameters:
        value = VALUES[name][number]
        assert found.effects[0].parameters[number].value == pytest.approx(value, rel=0.02)


def test_rows_that_replace_values_become_these_values(tmp_path: Path) -> None:
    d_m = '{ value = 8.0, unit = "N m s/rad", low = 7.0, high = 9.0 }'
    rows = listing("damping", {}, body='"motor"', d_m=d_m)
    rows += listing("torque_constant", {"k_t": 0.05}) + listing("coulomb", DRY)
    sheet = joint_of(tmp_path, rows)
    file = as_values(sheet.file, sheet.structure_row)
    known = file.parameters.quantities
    assert set(file.effects) == {"coulomb"}
    assert (known["d_m"].number, known["k_t"].number, known["d_l"].number) == (8.0, 0.05, 0.2)
    assert known["d_m"].tolerance == pytest.approx(2.0 / (2.0 * 1.96 * 8.0))
    assert known["k_t"].tolerance == 0.03  # as the datasheet's


@pytest.mark.slow
def test_what_the_stages_cannot_hold_is_left_to_predictions(tmp_path: Path) -> None:
    waves = {"f": "[20, 40]", "a": "[1.0, 0.5]", "b": "[0.0, 0.5]"}
    units = {"f": "1/rev", "a": "N m", "b": "N m"}
    rows = {k: f'{{ value = {x}, unit = "{units[k]}" }}' for k, x in waves.items()}
    sheet = joint_of(tmp_path, listing("cogging", {}, **rows))
    found = diagnose(record_of(sheet), sheet.file, STRUCTURE)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert all(np.isfinite(h.found) for h in found.horizons)
