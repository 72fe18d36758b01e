"""A stretch of a record in which something else acts is told, and nothing else is concluded."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.diagnosis import Diagnosis, Horizon, Interval, NamedEffect, Suggestion
from cjt_gym.gap.horizons.findings.answer import UNDISTURBED, _with_counts, at_the_floor
from cjt_gym.gap.horizons.findings.disturbance import disturbed
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.report.gather import nothing_said
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.simulator import nominal, simulate


def held(t: float, q: float, v: float) -> float:
    """Return the torque of a hand [N m]."""
    return -4000.0 * q - 40.0 * v if 1.4 < t < 2.2 else 0.0


def told(one: Record, two: Record) -> Diagnosis:
    """Return what is told of a joint that does what its datasheet says, but for a hand."""
    return diagnose(one, nominal(), validate=two)


def test_only_the_record_in_which_it_was_held_has_such_a_stretch() -> None:
    file, shape = nominal(), get_structure("output_fixed_rigid_gearbox")
    case = make_case([simulate(extra=held)], [simulate(seed=1)], file, shape)
    found = disturbed(case.fit, case.joint)
    assert found is not None
    assert 1.3 < found.start < found.stop - 0.3 < 2.0
    assert 0.9 < found.share <= 1.0
    assert disturbed(case.test, case.joint) is None


@pytest.mark.slow
@pytest.mark.parametrize("fitted", [True, False])
def test_a_hand_on_the_joint_is_no_joint_that_does_what_its_datasheet_says(fitted: bool) -> None:
    moved, free = simulate(extra=held), simulate(seed=1)
    found = told(moved, free) if fitted else told(free, moved)
    assert found.verdict == "unexplained"
    assert found.effects == ()
    said = re.search(r"from ([\d.]+) to ([\d.]+) s: look at what acted", found.unexplained.text)
    assert said is not None
    start, stop = (float(x) for x in said.groups())
    assert 1.3 < start < stop - 0.3 < 2.0


@pytest.mark.slow
def test_a_joint_that_nobody_holds_is_not_said_to_be() -> None:
    found = told(simulate(), simulate(seed=1))
    assert found.verdict == "no_gap"
    assert "look at what acted" not in found.unexplained.text


def test_what_acted_stays_told_where_the_floor_holds_it_too() -> None:
    file, shape = nominal(), get_structure("output_fixed_rigid_gearbox")
    blank = nothing_said(file, shape, [], [], "")
    rows = (Horizon(0.1, "q_m", 0.3, None, 0.3, 0.3),)
    quiet = replace(blank, verdict="unexplained", horizons=rows)
    assert at_the_floor(quiet, file, measured=True).verdict == "no_gap"
    told = replace(quiet, suggestion=Suggestion(UNDISTURBED))
    assert at_the_floor(told, file, measured=True) is told


@pytest.mark.parametrize(("times", "status"), [(3.0, "confirmed"), (4.0, "tentative")])
def test_steps_that_may_be_miscounted_are_not_confirmed(times: float, status: str) -> None:
    file = nominal()
    step = times * file.sensors["q_m"]["resolution"].number
    numbers = {"resolution": Interval(step, step, step, "rad")}
    row = NamedEffect("quantization", "sensing", None, "q_m", numbers, "confirmed", 0.95, 0.5)
    blank = nothing_said(file, get_structure("output_fixed_rigid_gearbox"), [], [], "")
    (found,) = _with_counts(replace(blank, effects=(row,)), file).effects
    assert found.status == status
