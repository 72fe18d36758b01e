"""Intervals beside motion that a model leaves though it is predictable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap.diagnosis import Diagnosis, Interval, NamedEffect
from cjt_gym.gap.horizons.findings.by_torque import _numbers
from cjt_gym.gap.horizons.findings.misfit import Wider, widened
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.terms import scales_of
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.selection.judgement import Judgement, Row
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.torque.cross_validated import Spent
from cjt_gym.gap.stages.intervals import NORMAL
from cjt_gym.joint import Joint, Quantity, get_structure
from cjt_gym.joint.files.diagnosed import covariance_of
from tests.gap.horizons.rotor import datasheet, record

DRY = Interval(2.0, 1.9, 2.1, "N m")


def _row(found: float, floor: float | None) -> Row:
    return Row(0.1, "q_m", 1.0, None, found, floor, None)


def test_the_worst_predicted_row_widens_the_intervals_of_a_fit() -> None:
    case = make_case([record()], [], datasheet(1.0, tolerance=0.1), get_structure("rigid"))
    problem = Problem(case.fit)
    fit = problem.fit(Model(case.joint, base_terms(case.joint, scales_of(case.joint, case.logs))))
    found = Found(fit, fit, (), (), ())

    def half(*rows: Row) -> float:  # of the damping, of which the datasheet tells nothing
        judged = Judgement(case, "found", case.joint, rows, found, problem=problem)
        return float(np.sqrt(judged.spread.matrix[1, 1]))

    least = half()
    assert least > 0.0
    assert half(_row(0.1, None), _row(0.04, 0.08)) == pytest.approx(least)
    worst = half(_row(0.3, 0.1))
    assert half(_row(0.12, 0.1), _row(0.3, 0.1)) == worst > half(_row(0.12, 0.1)) > least
    assert worst < 3.0 * least, "what the datasheet tells of the inertia stays as sure"
    assert half(_row(0.009, 0.001)) == pytest.approx(least)


@pytest.mark.parametrize("by", [1.0, 3.0, 50.0])
def test_intervals_of_the_stages_widen_within_what_a_number_may_be(
    explained: Diagnosis, by: float
) -> None:
    dry = NamedEffect("coulomb", "motor", "motor", None, {"d_cm": DRY}, "confirmed", 0.9, 1.0, ())
    rounded = replace(dry, name="quantization", parameters={"resolution": DRY})
    told = replace(explained, effects=(dry, rounded))
    entry = Quantity(2.0, "N m", "test", low=1.9, high=2.1)
    rows = {"coulomb": {"d_cm": entry}, "quantization": {"tau": entry}}
    told = replace(told, joint=replace(told.joint, effects=rows, found={}))
    wide = widened(told, Wider(by), {"quantization"})
    one = wide.effects[0].parameters["d_cm"]
    assert one.value == 2.0
    assert one.low == pytest.approx(max(2.0 - 0.1 * by, 0.0), abs=1e-9)
    assert one.high == pytest.approx(2.0 + 0.1 * by)
    listed = wide.joint.effects["coulomb"]["d_cm"]
    assert isinstance(listed, Quantity)
    assert (listed.low, listed.high) == (one.low, one.high)
    assert wide.effects[1] == rounded
    assert wide.joint.effects["quantization"] == told.joint.effects["quantization"]


@pytest.mark.parametrize("by", [1.0, 3.0])
def test_a_number_known_to_a_factor_stays_above_zero(explained: Diagnosis, by: float) -> None:
    vague = Interval(2.0, 0.2, 20.0, "N m")
    dry = NamedEffect("coulomb", "motor", "motor", None, {"d_cm": vague}, "confirmed", 0.9, 1.0, ())
    told = replace(explained, effects=(dry,), joint=replace(explained.joint, found={}))
    wide = widened(told, Wider(by), ())
    one = wide.effects[0].parameters["d_cm"]
    assert (one.low, one.high) == pytest.approx((2.0 * 0.1**by, 2.0 * 10.0**by))


def test_the_scale_of_all_torques_stays_as_it_is(explained: Diagnosis) -> None:
    """What a joint leaves unpredicted does not make a torque sensor worse."""
    common = 0.05
    known = covariance_of(explained.joint)
    assert known is not None
    scale = NORMAL * common * 2.0
    one = Interval(2.0, 2.0 - np.hypot(0.1, scale), 2.0 + np.hypot(0.1, scale), "N m")
    wide = Wider(3.0, common).of("coulomb", "d_cm", one)
    assert wide.high - 2.0 == pytest.approx(np.hypot(0.3, scale))
    assert 2.0 - wide.low == pytest.approx(np.hypot(0.3, scale))
    plain = covariance_of(Wider(3.0).joint(explained.joint, ()))
    assert plain is not None
    assert plain.matrix == pytest.approx(9.0 * known.matrix, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "value", "low"), [("coulomb", 0.1, 0.0), ("torque_offset", 0.1, -1.0)]
)
def test_an_interval_of_a_regression_stays_within_what_a_number_may_be(
    name: str, value: float, low: float
) -> None:
    joint = Joint(datasheet(), "rigid", "current", {})
    (one,) = _numbers(Spent(name, (value,), (1.0,), 0.5), joint).values()
    assert one.value == value
    assert one.high > 2.0
    assert one.low == 0.0 if low == 0.0 else one.low < low
