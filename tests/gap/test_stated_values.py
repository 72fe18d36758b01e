"""What a datasheet states with a tolerance, and what it leaves unstated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.recorded.series import stretches
from cjt_gym.gap.recorded.tolerances import strained, unnamed
from cjt_gym.gap.stages.kernel import smooth_speed
from cjt_gym.gap.stages.smoothing import with_smoothing
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record, default_units
from tests.gap.bench import STRUCTURE, joint_of, record_of
from tests.gap.simulator import nominal

FRICTION = """
d_cm = { value = 2.5, unit = "N m", source = "no-load current", tolerance = 0.2 }
[effects.coulomb]
"""


@pytest.mark.parametrize(("times", "told"), [(1.0, False), (2.0, True), (4.0, False)])
def test_a_value_that_moved_far_within_three_tolerances_is_told(times: float, told: bool) -> None:
    """Beyond three tolerances another sentence says so."""
    sheet = nominal()
    k_t = sheet.parameters.quantities["k_t"]
    moved = replace(k_t, value=k_t.value * (1.0 + times * (k_t.tolerance or 0.0)))
    found = replace(sheet, parameters=sheet.parameters.replace(k_t=moved))
    said = strained(sheet, found, ())
    assert bool(said) == told
    assert strained(sheet, found, {"k_t"}) == []
    assert all("k_t 0.0824 N m/A for 0.08" in text for text in said)


def test_a_value_with_a_wide_tolerance_that_moves_beyond_it_is_told(tmp_path: Path) -> None:
    """It is free like a guess, so that nothing else tells of it."""
    sheet = joint_of(tmp_path).file
    wide = Quantity(sheet.parameters.d_m, "N m s/rad", "test", 0.3)
    file = replace(sheet, parameters=sheet.parameters.replace(d_m=wide))
    far = replace(sheet, parameters=sheet.parameters.replace(d_m=4.0 * wide.number))
    (said,) = strained(file, far, ())
    assert "more than 3 times the datasheet's tolerance: d_m" in said
    guess = replace(file, parameters=file.parameters.replace(d_m=replace(wide, guess=True)))
    assert strained(guess, far, ()) == []
    near = replace(sheet, parameters=sheet.parameters.replace(d_m=1.2 * wide.number))
    assert strained(file, near, ()) == []


def test_a_lag_that_a_joint_has_without_a_name_is_told(tmp_path: Path) -> None:
    sheet = joint_of(tmp_path).file
    lag = {"bandwidth": Quantity(9.7, "Hz", "identified")}
    found = replace(sheet, effects={**sheet.effects, "current_lag": lag})
    (said,) = unnamed(sheet, found, ["coulomb"])
    assert said.startswith("joint.toml contains current_lag (9.7 Hz)")
    assert unnamed(sheet, found, ["current_lag"]) == unnamed(found, found, []) == []


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.9, 2.0])
def test_the_effect_that_frees_a_value_far_off_explains_it(tmp_path: Path, factor: float) -> None:
    sheet = joint_of(tmp_path)
    off = {"d_m": 3.0 * factor, "k_t": 1.01 * sheet.parameters.k_t}
    true = joint_of(tmp_path, parameters=off)
    found = diagnose(record_of(true), sheet.file, STRUCTURE)
    assert found.verdict == "explained"
    assert [e.name for e in found.effects] == ["damping"]
    assert found.effects[0].parameters["d_m"].value == pytest.approx(off["d_m"], rel=0.02)


@pytest.mark.parametrize("factor", [0.87, 1.15])
def test_of_values_that_explain_alike_the_one_is_named_beside_which_others_stay(
    tmp_path: Path, factor: float
) -> None:
    """More torque is less inertia and damping, until the datasheet tells which of them is off."""
    sheet = joint_of(tmp_path, structure="rigid").file
    known = sheet.parameters
    tight = {"k_t": 0.015, "I_m": 0.02, "I_l": 0.02, "d_m": 0.1, "d_l": 0.2}
    given = {name: replace(known.quantities[name], tolerance=t) for name, t in tight.items()}
    k_t = factor * known.k_t
    driven = record_of(joint_of(tmp_path, structure="rigid", parameters={"k_t": k_t}))
    columns = {name: driven[name] for name in ("t", "i_cmd", "q_m")}
    record = Record(columns, default_units(tuple(columns)), structure="rigid")
    found = diagnose(record, replace(sheet, parameters=known.replace(**given)))
    (effect,) = found.effects
    assert (effect.name, effect.status) == ("torque_constant", "tentative")
    assert "inertia" in effect.confusable_with
    assert effect.parameters["k_t"].low < k_t < effect.parameters["k_t"].high


def number_of(found: Diagnosis, effect: str, symbol: str) -> float:
    """Return a number of an effect of the joint that was found."""
    entry = found.joint.effects[effect][symbol]
    assert isinstance(entry, Quantity)
    return entry.number


def sticking(folder: Path, level: float, structure: str = STRUCTURE) -> Diagnosis:
    """Return the diagnosis of a joint that sticks, by a datasheet that does not say that it does.

    Its friction is 2.5 N m within 20 %.
    """
    sheet = joint_of(folder, FRICTION, structure)
    effects = {"coulomb": {"d_cm": level, "dq_0": 0.0}}
    true = joint_of(folder, structure=structure, effects=effects)
    return diagnose(record_of(true), sheet.file, structure)


@pytest.mark.slow
@pytest.mark.parametrize("structure", [STRUCTURE, "rigid"])
def test_friction_within_its_tolerance_is_refined(tmp_path: Path, structure: str) -> None:
    found = sticking(tmp_path, 2.8, structure)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert not any(stage.significant for stage in found.stages.values())
    level = number_of(found, "coulomb", "d_cm")
    if structure == "rigid":  # no torque is measured: all are known in proportion to k_t
        known = joint_of(tmp_path, FRICTION, structure).parameters.k_t
        level *= known / number_of(found, "torque_constant", "k_t")
    assert level == pytest.approx(2.8, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("level", [2.1, 2.42, 2.9])
def test_nothing_else_is_blamed_for_listed_friction_within_its_tolerance(
    tmp_path: Path, level: float
) -> None:
    listed = FRICTION.strip().splitlines()
    sheet = joint_of(tmp_path, "\n".join(reversed(listed)))
    true = joint_of(tmp_path, effects={"coulomb": {"d_cm": level, "dq_0": 0.0}})
    found = diagnose(record_of(true), sheet.file, STRUCTURE)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert number_of(found, "coulomb", "d_cm") == pytest.approx(level, rel=0.02)


@pytest.mark.parametrize("level", [0.2, 5.0])
def test_listed_friction_that_is_a_guess_is_found(tmp_path: Path, level: float) -> None:
    """Its level stands among the parameters, as well as the damping's, another guess."""
    guesses = FRICTION.replace("tolerance = 0.2", "guess = true")
    sheet = joint_of(tmp_path, guesses).file
    p = sheet.parameters
    damping = replace(p.quantities["d_m"], tolerance=None, guess=True)
    true = joint_of(tmp_path, effects={"coulomb": {"d_cm": level, "dq_0": 0.0}})
    file = replace(sheet, parameters=p.replace(d_m=damping))
    found = diagnose(record_of(true), file, STRUCTURE)
    assert (found.verdict, found.effects) == ("no_gap", ())
    assert number_of(found, "coulomb", "d_cm") == pytest.approx(level, rel=0.05)
    assert found.joint.parameters.d_m == pytest.approx(p.d_m, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("symbol", "factor", "name"), [("k_t", 0.89, "torque_constant"), ("d_m", 1.8, "damping")]
)
def test_a_value_that_left_its_tolerance_by_little_is_named(
    tmp_path: Path, symbol: str, factor: float, name: str
) -> None:
    sheet = joint_of(tmp_path)
    value = factor * sheet.parameters.get(symbol, 0.0)
    found = diagnose(record_of(joint_of(tmp_path, parameters={symbol: value})), sheet)
    assert (found.verdict, [e.name for e in found.effects]) == ("explained", [name])
    assert found.effects[0].parameters[symbol].value == pytest.approx(value, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("structure", [STRUCTURE, "rigid"])
def test_friction_beyond_its_tolerance_is_named(tmp_path: Path, structure: str) -> None:
    found = sticking(tmp_path, 5.0, structure)
    assert [e.name for e in found.effects] == ["coulomb"]
    assert found.effects[0].parameters["d_cm"].value == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("width", [0.0, 0.002])
def test_unstated_smoothing_is_what_the_record_shows(tmp_path: Path, width: float) -> None:
    sheet = joint_of(tmp_path, FRICTION)
    true = joint_of(tmp_path, effects={"coulomb": {"d_cm": 2.5, "dq_0": width}})
    told = with_smoothing(sheet.file, sheet.structure_row, stretches([record_of(true)]))
    sharp = told.effects["coulomb"].get("dq_0")
    assert (sharp is not None and sharp.number == 0.0) == (width == 0.0)  # type: ignore[union-attr]


@given(
    start=st.floats(-3.0, 3.0),
    free=st.floats(-3.0, 3.0),
    reach=st.floats(1e-4, 2.0),
    width=st.floats(1e-4, 0.1),
)
def test_a_step_of_smoothed_friction_solves_its_equation(
    start: float, free: float, reach: float, width: float
) -> None:
    """`reach` is the velocity that friction takes from a sliding body within a sample."""
    v = smooth_speed(start, free, 1.0, reach, width)
    stiff = reach / width
    share = 0.5 if stiff < 1e-3 else 1.0 / (1.0 - math.exp(-stiff)) - 1.0 / stiff
    between = start + share * (v - start)
    assert v == pytest.approx(free - reach * math.tanh(between / width), abs=1e-6)
