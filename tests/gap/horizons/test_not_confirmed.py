"""What is not confirmed, whatever the fit says, because a record cannot identify it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.check.faults import FACTOR, ONE_INSTANT, SCALES, SLOPES, UNITS
from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.horizons.findings.naming import as_plain
from cjt_gym.gap.horizons.findings.not_confirmed import allowed_by
from cjt_gym.gap.horizons.torque.inverse import ONE_WAY
from tests.gap.horizons.rotor import datasheet, record


@pytest.fixture(scope="module")
def told() -> Diagnosis:
    return diagnose(record(), datasheet(), "rigid")


def test_nothing_is_confirmed_where_instants_or_a_velocity_contradict(told: Diagnosis) -> None:
    sure = tuple(replace(e, status="confirmed", confusable_with=()) for e in told.effects)
    assert told.examination is not None
    doubts = ((ONE_INSTANT,), (SLOPES,), (FACTOR,), (SCALES,), (UNITS,))
    for advice, status in (((), "confirmed"), *((one, "tentative") for one in doubts)):
        exam = replace(told.examination, advice=advice)
        found = allowed_by(replace(told, effects=sure, examination=exam), {})
        assert {e.status for e in found.effects} == {status}


@pytest.mark.parametrize(
    ("name", "numbers", "excluded", "span", "said"),
    [
        ("cogging", {"f": 7.0}, ("torque_offset", "coulomb_asym"), 20.0, "in one direction"),
        ("cogging", {"f": 7.0}, (), 20.0, ""),
        ("gravity", {"torque": 3.0}, (), 0.4, "a spring to the frame"),
        ("gravity", {"torque": 3.0}, (), 2.0, ""),
        ("coulomb_asym", {"d_cm": 0.0, "d_cm_n": 0.1}, (), 2.0, "an offset beside equal"),
        ("coulomb_asym", {"d_cm": 0.3, "d_cm_n": 0.1}, (), 2.0, ""),
        ("thermal_derating", {"T_thw": 1.0}, (), 2.0, "what is no heat"),
        ("thermal_derating", {"T_thw": 9.0}, (), 2.0, ""),
    ],
)
def test_what_looks_like_an_effect_is_told_and_the_effect_not_confirmed(
    told: Diagnosis, name: str, numbers: dict[str, float], excluded: tuple[str, ...],
    span: float, said: str,
) -> None:  # fmt: skip
    values = {symbol: Interval(x, 0.999 * x, 1.001 * x, "-") for symbol, x in numbers.items()}
    effect = NamedEffect(name, "motor", "motor", None, values, "confirmed", 0.9, 0.5)
    assert told.examination is not None
    angle = replace(told.examination.channels["q_m"], low=0.0, high=span)
    exam = replace(told.examination, channels={"q_m": angle}, advice=())
    given = replace(told, effects=(effect,), examination=exam)
    (found,) = allowed_by(given, dict.fromkeys(excluded, "")).effects
    assert found.status == ("tentative" if said else "confirmed")
    assert said in found.doubt


@pytest.mark.parametrize(
    ("name", "symbol", "low", "high", "status"),
    [
        ("damping", "d_m", 0.0, 92.0, "tentative"),
        ("damping", "d_m", 30.0, 92.0, "confirmed"),
        ("torque_offset", "torque", -2.0, 0.5, "tentative"),
        ("torque_gain", "gain", 0.9, 1.1, "tentative"),
        ("torque_gain", "gain", 0.8, 0.9, "confirmed"),
    ],
)
def test_what_may_not_be_there_is_not_confirmed(
    told: Diagnosis, name: str, symbol: str, low: float, high: float, status: str
) -> None:
    size = {symbol: Interval(0.5 * (low + high), low, high, "-")}
    effect = NamedEffect(name, "motor", "motor", None, size, "confirmed", 0.99, 0.9)
    joint = replace(told.joint, parameters=told.joint.parameters.replace(d_m=0.0))
    given = replace(told, effects=(effect,), joint=joint)
    (one,) = allowed_by(given, {}).effects
    assert one.status == status
    assert ("its absence" in one.doubt) == (status == "tentative")


@pytest.mark.parametrize(("back", "status"), [(0.0, "confirmed"), (0.05, "tentative")])
def test_damping_is_not_confirmed_where_one_way_motion_creeps_back(
    told: Diagnosis, back: float, status: str
) -> None:
    """Dry friction turns round there, a weight that is taken for friction does not."""
    sizes = {"damping": ("d_m", 0.2), "coulomb": ("d_cm", 1.0)}
    effects = tuple(
        NamedEffect(
            name, "motor", "motor", None, {symbol: Interval(x, 0.9 * x, 1.1 * x, "-")},
            "confirmed", 0.99, 0.5,
        )
        for name, (symbol, x) in sizes.items()
    )  # fmt: skip
    assert told.examination is not None
    joint = replace(told.joint, parameters=told.joint.parameters.replace(d_m=0.0))
    given = replace(told, effects=effects, examination=replace(told.examination, back=back))
    found = allowed_by(replace(given, joint=joint), dict.fromkeys(ONE_WAY, "one way")).effects
    assert {e.name: e.status for e in found} == {"damping": status, "coulomb": "tentative"}


@pytest.mark.parametrize(("high", "status"), [(0.3, "confirmed"), (3.0, "tentative")])
def test_friction_that_falls_over_no_certain_speed_is_not_confirmed(
    told: Diagnosis, high: float, status: str
) -> None:
    size = {
        "d_cm": Interval(0.2, 0.19, 0.21, "N m"), "d_sm": Interval(0.1, 0.09, 0.11, "N m"),
        "v_s": Interval(0.2, 0.1, high, "rad/s"),
    }  # fmt: skip
    effect = NamedEffect("stribeck", "motor", "motor", None, size, "confirmed", 0.99, 0.9)
    (one,) = allowed_by(replace(told, effects=(effect,)), {}).effects
    assert one.status == status
    assert ("coulomb" in one.confusable_with) == (status == "tentative")


@pytest.mark.parametrize(
    ("ratio", "status"),
    [(0.01745, "tentative"), (0.5, "confirmed"), (3.0, "confirmed"), (57.3, "tentative")],
)
def test_a_value_that_is_off_like_another_unit_is_not_confirmed(
    told: Diagnosis, ratio: float, status: str
) -> None:
    found = ratio * told.joint.parameters.I_m
    size = {"I_m": Interval(found, 0.99 * found, 1.01 * found, "kg m^2")}
    effect = NamedEffect("inertia", "motor", None, None, size, "confirmed", 0.99, 0.9)
    (one,) = allowed_by(replace(told, effects=(effect,)), {}).effects
    assert one.status == status
    assert ("a unit, a side or a gear ratio" in one.doubt) == (status == "tentative")


def test_of_effects_that_explain_as_much_the_surer_come_first(told: Diagnosis) -> None:
    def one(name: str, status: str, removed: float) -> NamedEffect:
        size = {"noise": Interval(0.1, 0.09, 0.11, "rad")}
        return NamedEffect(name, "sensing", None, "q_m", size, status, 0.9, removed)

    given = (
        one("stiffness", "tentative", 0.5), one("backlash", "tentative", 0.1),
        one("quantization", "confirmed", 0.1), one("noise", "confirmed", 0.0),
    )  # fmt: skip
    found = allowed_by(replace(told, effects=given), {}).effects
    assert [e.name for e in found] == ["stiffness", "quantization", "backlash", "noise"]


def test_one_of_several_effects_that_fit_alike_is_not_confirmed(told: Diagnosis) -> None:
    torque = {"torque": Interval(0.1, 0.09, 0.11, "N m")}
    for alike, status in (((), "confirmed"), (("coulomb_asym",), "tentative")):
        offset = NamedEffect(
            "torque_offset", "motor", None, None, torque, "confirmed", 0.9, 0.5, alike
        )
        (found,) = allowed_by(replace(told, effects=(offset,)), {}).effects
        assert found.status == status
        assert found.doubt == ("coulomb_asym may take its place" if alike else "")


@pytest.mark.parametrize(
    ("fault", "status"), [(SLOPES, "confirmed"), (FACTOR, "tentative"), (SCALES, "tentative")]
)
def test_beside_a_wrong_unit_no_steps_are_confirmed(
    told: Diagnosis, fault: str, status: str
) -> None:
    steps = {"resolution": Interval(1.0, 1.0, 1.0, "N m")}
    effect = NamedEffect(
        "quantization", "sensor", "tau", "tau", steps, "confirmed", 0.9, 0.2, (), 1.0
    )  # fmt: skip
    assert told.examination is not None
    exam = replace(told.examination, advice=(fault,))
    (found,) = allowed_by(replace(told, effects=(effect,), examination=exam), {}).effects
    assert found.status == status


def test_dry_friction_is_not_confirmed_where_viscous_friction_cannot_be_told(
    told: Diagnosis,
) -> None:
    sure = replace(
        told,
        effects=tuple(replace(e, status="confirmed", confusable_with=()) for e in told.effects),
    )
    dry = {e.name for e in sure.effects} & {"coulomb"}
    assert dry
    doubted = {e.name for e in allowed_by(sure, {"damping": "one speed"}).effects if e.doubt}
    assert dry <= doubted
    assert all(e.status == "confirmed" for e in allowed_by(sure, {"stribeck": ""}).effects)


@pytest.mark.parametrize(
    ("back", "half", "status"),
    [(6.5, 2.0, "tentative"), (9.0, 2.0, "confirmed"), (5.6, 0.01, "tentative")],
)
def test_friction_is_not_asymmetric_where_the_directions_hardly_differ(
    told: Diagnosis, back: float, half: float, status: str
) -> None:
    numbers = {
        "d_l": Interval(5.5, 5.5 - half, 5.5 + half, "N m s/rad"),
        "d_l_n": Interval(back, back - half, back + half, "N m s/rad"),
    }
    effect = NamedEffect(
        "viscous_asym", "load", "load", None, numbers, "confirmed", 0.9, 0.2, (), 1.0
    )  # fmt: skip
    (found,) = allowed_by(replace(told, effects=(effect,)), {}).effects
    assert found.status == status
    assert ("damping" in found.confusable_with) == (status == "tentative")


@pytest.mark.parametrize(
    ("cycles", "status"), [(0.4, "confirmed"), (1.5, "tentative")], ids=["in step", "out of step"]
)
def test_a_wave_whose_ends_may_be_out_of_step_is_not_confirmed(
    told: Diagnosis, cycles: float, status: str
) -> None:
    assert told.examination is not None
    half = 0.5 * cycles / (told.examination.channels["q_m"].span / (2.0 * np.pi))
    f = 40.0 * half  # its frequency is known within 5 % in either case
    numbers = {"f": Interval(f, f - half, f + half, "1/rev")}
    effect = NamedEffect(
        "cogging", "motor", "motor", None, numbers, "confirmed", 0.9, 0.2, (), 1.0
    )  # fmt: skip
    (found,) = allowed_by(replace(told, effects=(effect,)), {}).effects
    assert found.status == status


@pytest.mark.parametrize(
    ("back", "alike", "level"),
    [
        (0.5, ("coulomb",), 0.55),
        (0.0, ("coulomb", "torque_offset"), 0.3),
        (0.0, ("coulomb",), None),
        (0.25, ("coulomb", "torque_offset"), None),
        (0.5, (), None),
    ],
)
def test_friction_of_one_direction_is_plain_friction_beside_an_offset(
    back: float, alike: tuple[str, ...], level: float | None
) -> None:
    numbers = {"d_cm": Interval(0.6, 0.5, 0.7, "N m"), "d_cm_n": Interval(back, 0.0, 0.9, "N m")}
    effect = NamedEffect(
        "coulomb_asym", "motor", "motor", None, numbers, "tentative", 0.5, 0.5, alike, 1.0
    )  # fmt: skip
    told = as_plain(effect)
    if level is None:
        assert told is effect
        return
    assert told.name == "coulomb"
    (one,) = told.parameters.values()
    assert one.value == pytest.approx(level)
    assert one.low <= 0.25 <= 0.8 <= one.high
    assert told.confusable_with == ("coulomb_asym", *alike[1:])


@pytest.mark.parametrize(
    ("rise", "name"),
    [((0.0, 0.07), "coulomb"), ((0.01, 0.07), "stribeck"), ((0.0, 0.6), "stribeck")],
)
def test_friction_that_may_not_fall_at_all_is_plain(rise: tuple[float, float], name: str) -> None:
    numbers = {
        "d_cm": Interval(0.5, 0.45, 0.55, "N m"), "d_sm": Interval(0.02, *rise, "N m"),
        "v_s": Interval(0.1, 0.01, 1.5, "rad/s"),
    }  # fmt: skip
    effect = NamedEffect("stribeck", "motor", "motor", None, numbers, "tentative", 0.5, 0.5)
    told = as_plain(effect)
    assert told.name == name
    if name == "coulomb":
        assert told.parameters == {"d_cm": numbers["d_cm"]}
        assert told.confusable_with == ("stribeck",)
