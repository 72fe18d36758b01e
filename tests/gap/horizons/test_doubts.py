"""What is fitted but not told, told in doubt, or told beside the answer."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import diagnose
from cjt_gym.gap.candidates.drive import drive_rows
from cjt_gym.gap.diagnosis import Interval, NamedEffect
from cjt_gym.gap.horizons.findings.found_joint import _torn
from cjt_gym.gap.horizons.findings.held_output import held_alike
from cjt_gym.gap.horizons.findings.naming import _is_dry
from cjt_gym.gap.horizons.findings.naming_rules import is_named, may_be_as_stated
from cjt_gym.gap.horizons.findings.verdict import unexplained_of, verdict_of
from cjt_gym.gap.horizons.fitting.base_terms import base_terms, freed
from cjt_gym.gap.horizons.fitting.covariance import Scatter
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.fitting.terms import _torque_sensor, candidates, scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import Spread
from cjt_gym.gap.horizons.prediction.case import Case, make_case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.prediction.placement import WHOLE
from cjt_gym.gap.horizons.prediction.predictable import Predictable
from cjt_gym.gap.horizons.selection.choice import _loses, are_sound, best_of
from cjt_gym.gap.horizons.selection.judgement import NEAR, Judgement, Row
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.selection.stepwise import added
from cjt_gym.gap.horizons.selection.worth import Worth
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.horizons.torque.inverse import seen_in_torque
from cjt_gym.gap.recorded.cut import Cut
from cjt_gym.gap.recorded.setting import make_setting
from cjt_gym.joint import get_structure
from cjt_gym.joint.joint import Joint
from cjt_gym.records import Record
from tests.gap.horizons.rotor import DAMPING, DRY, INERTIA, datasheet, record

RIGID = get_structure("rigid")
CLEAR = Worth(fall=100.0, clear=20.0, rest=90.0, price=3.0)


def told_as(**values: float) -> dict[str, Spent]:
    """Return effects that a regression of the torque tells."""
    return {name: Spent(name, (x,), (0.01 * x,), 0.5) for name, x in values.items()}


@pytest.fixture(scope="module")
def case() -> Case:
    return make_case([record()], [], datasheet(), RIGID)


def test_a_weight_that_the_torque_of_a_single_mass_does_not_show_is_not_told(case: Case) -> None:
    scale = scales_of(case.joint, case.logs)
    base = Problem(case.fit).fit(Model(case.joint, base_terms(case.joint, scale)), np.zeros(3))
    weight = next(t for t in candidates(case.joint, scale, case.logs) if t.name == "gravity")
    fit = Fit(*added(base, weight, weight.starts[0]), 0.0, [])
    at = len(fit.model.terms) - 1
    found = Found(fit, base, (CLEAR,) * (at + 1), ((),) * (at + 1), (base,) * (at + 1))
    judged = Judgement(case, "found", case.joint, (), found=found)
    shown: Any = SimpleNamespace(values=fit.model.values(fit.z)[at])
    assert not is_named(judged, at, weight, {"coulomb": shown})
    assert is_named(judged, at, weight, {"coulomb": shown, "gravity": shown})
    unknown = replace(case, logs=tuple(replace(log, measured={}) for log in case.logs))
    assert is_named(replace(judged, case=unknown), at, weight, {}), "no regression, no refutation"


def test_a_damping_that_stands_for_the_dry_friction_of_the_torque_is_told_in_doubt(
    case: Case,
) -> None:
    seen = seen_in_torque(case.joint, case.logs)
    assert "coulomb" in seen
    model = Model(case.joint, base_terms(case.joint, scales_of(case.joint, case.logs)))
    at = [t.name for t in model.terms].index("damping")
    z = np.zeros(len(model.terms))
    for damping, doubted in ((DAMPING, False), (4.0 * DAMPING, True)):
        z[at] = model.terms[at].numbers[0].coordinate(damping)
        fit: Any = SimpleNamespace(fit=Fit(model, z, 0.0, []))
        judged = Judgement(case, "found", case.joint, (), found=fit)
        told = told_as(damping=DAMPING)
        assert _is_dry(judged, at, {**told, "coulomb": seen["coulomb"]}) == doubted
        assert not _is_dry(judged, at, told), "no dry friction is seen"


@pytest.mark.parametrize(("factor", "torn"), [(2.0, True), (1.0, False)])
def test_an_inertia_on_which_torque_and_predictions_disagree_spans_both(
    case: Case, factor: float, torn: bool
) -> None:
    """The datasheet of this rotor states twice its inertia; the regression finds the true one."""
    model = Model(case.joint, base_terms(case.joint, scales_of(case.joint, case.logs))[:1])
    z = np.array([model.terms[0].numbers[0].coordinate(factor / 2.0)])
    fit: Any = SimpleNamespace(model=model, z=z)
    scatter = Scatter.of(Spread(fit, np.array([[4e-4]]), 2.0, np.array([[4e-4]])))
    found = _torn(Judgement(case, "found", case.joint, ()), scatter)
    assert bool(found) == torn
    for one in found.values():
        assert one.low < 1.05 * INERTIA < one.high
        assert one.value == pytest.approx(factor * INERTIA)


def test_no_limit_lies_below_a_current_that_was_reached() -> None:
    """A drive that gives half of what is asked for is weak, not saturated."""
    t = 2e-3 * np.arange(4000)
    asked = 2.0 * np.sin(2.0 * np.pi * 0.9 * t)
    columns = {"t": t, "i_cmd": asked, "i": 0.5 * asked, "q_m": np.cumsum(asked) * 1e-3}
    units = {"t": "s", "i_cmd": "A", "i": "A", "q_m": "rad"}
    setting = make_setting(Record(columns, units, structure="rigid"), datasheet(), RIGID)
    rows = drive_rows(setting)
    (limit,) = next(row for row in rows if row.name == "current_saturation").unknowns
    assert 0.9 < limit.low <= 1.0


def test_the_inertia_of_a_joint_that_coasts_stays_as_given(case: Case) -> None:
    """Nothing but the datasheet tells it; with another, all friction would be off alike."""
    idle = [replace(log, command=0.0 * log.command) for log in case.logs]
    for logs, coasts in ((case.logs, False), (idle, True)):
        scale = scales_of(case.joint, logs)
        terms = base_terms(case.joint, scale)
        assert (terms[0].numbers[0].scale < 0.01) == scale.coasts == coasts
        assert not (coasts and "inertia" in {term.name for term in freed(terms)})


def test_what_gives_way_by_a_turn_is_no_presliding(case: Case) -> None:
    scale = replace(scales_of(case.joint, case.logs), travel=1e3)
    bristles = next(t for t in candidates(case.joint, scale, case.logs) if t.name == "presliding")
    (number,) = bristles.numbers
    assert scale.torque / number.low == pytest.approx(0.2)
    assert all(number.low <= x < number.high for (x,) in bristles.starts)


@pytest.mark.parametrize(
    ("fitted", "low", "high", "same"),
    [
        (0.0, 0.0, 0.3, True),
        (0.0, 0.0, 0.05, False),
        (0.2, 0.15, 0.25, False),
        (0.2, 0.05, 1, True),
    ],
)
def test_a_damping_that_may_be_as_stated_is_no_cause(
    case: Case, fitted: float, low: float, high: float, same: bool
) -> None:
    damping = next(
        t for t in base_terms(case.joint, scales_of(case.joint, case.logs)) if t.name == "damping"
    )
    stated = replace(damping, nominal=(0.1,))
    number = {"d_m": Interval(fitted, low, high, "N m s/rad")}
    effect = NamedEffect(
        "damping", "motor", "motor", None, number, "confirmed", 0.9, 0.2, (), 1.0
    )  # fmt: skip
    fit = Fit(Model(case.joint, (stated,)), np.zeros(1), 0.0, [])
    spread = Spread(fit, np.zeros((1, 1)), 2.0, np.zeros((1, 1)))
    assert may_be_as_stated(spread, stated, effect) == same
    assert not may_be_as_stated(spread, replace(stated, nominal=(0.0,)), effect)


def test_stages_give_way_to_a_search_that_predicts_a_held_output_better(case: Case) -> None:
    keys = (("tau", 0.02), ("tau", WHOLE))
    held: Any = SimpleNamespace(test=SimpleNamespace(keys=keys))
    short, own, other, near = (np.full((4, 4), x) for x in (0.02, 0.33, 0.24, 0.31))
    assert _loses(held, NEAR, [short, own], [short, other])
    assert not _loses(held, NEAR, [short, own], [short, near])
    assert not _loses(held, 2.0 * NEAR, [short, own], [short, other]), "which is little enough"
    assert not _loses(held, NEAR, [own, short], [other, short]), "pieces of a tenth may drift"


def test_stages_give_way_to_a_regression_that_predicts_clearly_better(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The datasheet of this rotor states twice its inertia and no friction."""
    dry = {"d_cm": DRY, "d_cg": 0.0, "d_cl": 0.0, "dq_0": 0.0}
    right = Joint(datasheet(1.0), "rigid", "current", {"coulomb": dry})
    joints = {"datasheet": case.joint, "least squares": right, "stages": case.joint}
    assert not are_sound(case, joints)
    assert are_sound(case, joints | {"stages": right})
    assert not are_sound(case, {"datasheet": right, "stages": case.joint})
    monkeypatch.setattr(Case, "cut", Cut.BY_TORQUE)  # nor do stages that a spring separates
    assert best_of(case, Problem(case.test), joints, NEAR) == "least squares"
    assert best_of(case, Problem(case.test), joints | {"stages": right}, NEAR) == "stages"


def test_a_torque_sensor_that_never_changes_has_no_fault_to_look_for(case: Case) -> None:
    (log,) = case.logs
    names = []
    for tau in (np.full(len(log.command), 1.2), np.sin(np.arange(len(log.command)))):
        logs = [replace(log, measured={**log.measured, "tau": tau})]
        names.append({t.name for t in candidates(case.joint, scales_of(case.joint, logs), logs)})
    assert "torque_bias" in {t.name for t in _torque_sensor(logs)}
    assert not {"torque_bias", "torque_gain"} & names[0]


@pytest.mark.parametrize(("further", "open_"), [(0.02, False), (0.05, True)])
def test_what_is_left_of_the_measured_start_alone_is_not_unexplained(
    further: float, open_: bool, case: Case
) -> None:
    left = Predictable(0.6, 0.05)
    sizes = {0.02: 0.08, 0.1: further, 0.5: 0.01}
    rows = tuple(Row(s, "q_m", 1.0, None, x, 0.5 * x, left) for s, x in sizes.items())
    assert bool(Judgement(case, "found", case.joint, rows).unexplained) == open_


@pytest.mark.parametrize(("floor", "open_"), [(0.040, False), (0.020, True)])
def test_nor_is_it_where_errors_further_ahead_are_near_their_floor(
    floor: float, open_: bool, case: Case
) -> None:
    sizes = {0.02: (0.29, 0.09), 0.1: (0.048, floor), 0.5: (0.004, 0.003)}
    rows = tuple(
        Row(s, "q_m", 1.0, None, found, least, Predictable(1.0 - (least / found) ** 2, 0.05))
        for s, (found, least) in sizes.items()
    )
    assert bool(Judgement(case, "found", case.joint, rows).unexplained) == open_


@pytest.mark.parametrize(
    ("left", "verdict"),
    [
        (None, "unexplained"),
        (Predictable(0.02, 0.05), "no_gap"),
        (Predictable(0.6, 0.3), "unexplained"),
    ],
)
def test_what_nobody_could_judge_is_not_called_no_gap(
    left: Predictable | None, verdict: str, case: Case
) -> None:
    """Of a short record no regression tells surely whether 42 % of the motion is predictable."""
    rows = tuple(Row(s, "q_m", 0.5, None, 0.42, 0.4 if left else None, left) for s in (0.02, 0.1))
    judged = Judgement(case, "base", case.joint, rows)
    assert verdict_of(judged, (), suspected=False) == verdict
    said = unexplained_of(judged, verdict, ()).text
    assert ("does not tell how much of it could be" in said) == (verdict == "unexplained")


@pytest.mark.parametrize(
    ("offset", "seen", "verdict"),
    [(1e-4, True, "no_gap"), (0.5, True, "unexplained"), (0.0, False, "no_gap")],
)
def test_only_values_that_errors_show_to_be_off_leave_a_gap_without_a_name(
    offset: float, seen: bool, verdict: str, case: Case
) -> None:
    """Not the usual offset of an amplifier, nor damping that a fit may as well take as stated."""
    scales = scales_of(case.joint, case.logs)
    base = Model(case.joint, base_terms(case.joint, scales))
    weak = Worth(fall=5.0, clear=20.0 if seen else -1.0, rest=1.0, price=3.0)
    fit = Fit(base, np.zeros(len(base.numbers)), 0.0, [])
    if offset:
        constant = next(
            t for t in candidates(case.joint, scales, case.logs) if t.name == "torque_offset"
        )
        fit = Fit(*added(fit, constant, (offset,)), 0.0, [])
    else:
        constant = next(t for t in freed(base.terms) if t.name == "torque_constant")
        fit = Fit(*added(fit, constant, (1.5 * constant.nominal[0],)), 0.0, [])
    count = len(fit.model.terms)
    found = Found(fit, fit, (weak,) * count, ((),) * count, (fit,) * count)
    rows = (Row(0.5, "q_m", 0.5, None, 0.02, 0.02, Predictable(0.0, 0.1)),)
    judged = Judgement(case, "found", case.joint, rows, found=found)
    assert verdict_of(judged, (), suspected=False) == verdict


@pytest.mark.parametrize("name", ["presliding", "spring_hysteresis", "coulomb"])
def test_only_a_measured_torque_tells_whose_friction_holds_a_joint(name: str) -> None:
    held: Any = SimpleNamespace(structure_row=SimpleNamespace(output_fixed=True))
    free: Any = SimpleNamespace(structure_row=SimpleNamespace(output_fixed=False))
    unfelt: Any = SimpleNamespace(measured={"q_m": 0.0}, drive="i")
    felt: Any = SimpleNamespace(measured={"q_m": 0.0, "tau": 0.0}, drive="i")
    assert held_alike(name, held, unfelt)
    assert held_alike(name, held, felt) == held_alike(name, free, unfelt) == ()


def test_volts_are_no_current(case: Case) -> None:
    made = record(2.0)
    volts = Record(
        {"t": made.t, "i_cmd": made["i"], "q_m": made["q_m"]},
        {"t": "s", "i_cmd": "V", "q_m": "rad"},
        structure="rigid",
    )
    with pytest.raises(RecordError, match="must be a current, as k_t of rotor is in N m/A"):
        diagnose(volts, datasheet())


@pytest.mark.parametrize(("factor", "alone"), [(0.67, True), (0.9, False)])
def test_a_value_that_left_its_tolerance_by_far_is_named_where_nothing_else_is(
    factor: float, alone: bool
) -> None:
    off = make_case([record()], [], datasheet(1.5, tolerance=0.05), RIGID)
    terms = base_terms(off.joint, scales_of(off.joint, off.logs))
    loose = next(t for t in freed(terms) if t.name == "inertia")
    model = Model(off.joint, (loose, *terms[1:]))
    z = np.zeros(len(model.numbers))
    z[0] = loose.numbers[0].coordinate(factor)
    fits = [Fit(m, x, 0.0, []) for m, x in ((model, z), (Model(off.joint, terms), 0.0 * z))]
    weak = replace(CLEAR, clear=0.5)
    found = Found(*fits, (weak,) * len(terms), ((),) * len(terms), (fits[1],) * len(terms))
    judged = Judgement(off, "found", off.joint, (), found=found)
    assert not is_named(judged, 0, loose, {})
    assert is_named(judged, 0, loose, {}, alone=True) == alone


def test_what_nothing_was_held_out_to_test_is_told_in_doubt() -> None:
    short, other = record(8.0, seed=1), record(8.0, seed=2)
    alone = diagnose(short, datasheet(), "rigid")
    tested = diagnose(short, datasheet(), "rigid", validate=other)
    assert (alone.gap.held_out, tested.gap.held_out) == (False, True)
    status = [{e.name: e.status for e in found.effects} for found in (alone, tested)]
    assert [one["coulomb"] for one in status] == ["tentative", "confirmed"]
    assert "second record" in next(e.doubt for e in alone.effects if e.name == "coulomb")
    assert "the fitted data" in str(alone)
    assert "the fitted data" not in str(tested)
