"""How sure the numbers of a joint file are, from how sure the coordinates of a fit are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.covariance import Scatter
from cjt_gym.gap.horizons.fitting.fit import Problem
from cjt_gym.gap.horizons.fitting.terms import _friction, candidates, gravity, scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import Spread
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Model, Scales
from cjt_gym.gap.horizons.prediction.pieces import cut, split
from cjt_gym.gap.horizons.selection.judge import _finer
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.joint import Joint
from tests.gap.horizons.rotor import DRY, datasheet, record

SCALES = Scales(torque=1.0, speed=1.0, peak=2.0, travel=3.0)


def scatter(terms: Any, z: list[float], matrix: Any) -> Scatter:
    model = Model(Joint(datasheet(), "rigid", "current", {}), tuple(terms))
    fit: Any = SimpleNamespace(model=model, z=np.array(z))
    matrix = np.asarray(matrix, dtype=float)
    return Scatter.of(Spread(fit, matrix, 2.0, matrix))


def test_a_number_that_is_fitted_as_a_difference_gets_the_interval_of_its_own() -> None:
    joint = Joint(datasheet(), "rigid", "current", {})
    damping = base_terms(joint, SCALES)[1]
    skew = next(t for t in _friction(joint, SCALES, "m") if t.name == "viscous_asym")
    steps = [t.numbers[0].scale for t in (damping, skew)]
    found = scatter([damping, skew], [0.3 / steps[0], 0.2 / steps[1]], [[1.0, 0.5], [0.5, 4.0]])
    assert found.names == ("damping.d_m", "viscous_asym.d_m_n")
    assert found.values == pytest.approx([0.3, 0.5])
    own, both = steps[0] ** 2, steps[0] ** 2 + steps[0] * steps[1] + 4.0 * steps[1] ** 2
    cross = steps[0] ** 2 + 0.5 * steps[0] * steps[1]
    assert found.matrix == pytest.approx(np.array([[own, cross], [cross, both]]), rel=1e-6)
    ends = found.intervals()["viscous_asym.d_m_n"]
    half = 2.0 * np.sqrt(both)
    assert (ends.low, ends.high) == pytest.approx((max(0.5 - half, 0.0), 0.5 + half), rel=1e-6)


def test_damping_backward_is_as_forward_that_of_all_bodies_that_move_with_the_motor() -> None:
    geared = JointFile(datasheet().parameters.replace(d_g=0.2))
    joint = Joint(geared, "rigid", "current", {})
    damping = base_terms(joint, SCALES)[1]
    skew = next(t for t in _friction(joint, SCALES, "m") if t.name == "viscous_asym")
    rows = Model(joint, (damping, skew)).draft(np.zeros(2)).effects
    forward, backward = (rows[name] for name in ("damping", "viscous_asym"))
    assert forward["d_m"] >= 0.2
    assert backward["d_m_n"] == pytest.approx(forward["d_m"])
    assert [backward[f"d_{body}_n"] for body in "gl"] == [0.0, 0.0]


def test_the_components_of_a_weight_become_its_size_and_angle() -> None:
    joint = Joint(datasheet(), "rigid", "current", {})
    term = gravity(joint, SCALES)
    size = term.numbers[0].scale
    found = scatter([term], [0.0, 1.0 / size], np.diag([1e-4, 4e-4]) / size**2)
    assert dict(zip(found.names, found.values, strict=True)) == pytest.approx(
        {"gravity.torque": 1.0, "gravity.angle": 0.0}, abs=1e-12
    )
    assert found.matrix == pytest.approx(np.diag([4e-4, 1e-4]), rel=1e-3, abs=1e-9)


def test_a_weight_that_may_be_none_has_an_interval_down_to_zero_with_its_value_inside() -> None:
    term = gravity(Joint(datasheet(), "rigid", "current", {}), SCALES)
    size = term.numbers[0].scale
    found = scatter([term], [0.0, 0.15 / size], np.diag([1e-6, 0.25]) / size**2)
    ends = found.intervals()["gravity.torque"]
    assert ends.low == pytest.approx(0.0, abs=0.11)
    assert (ends.value, ends.high) == pytest.approx((0.15, 1.15))


@pytest.mark.parametrize(
    ("z", "deviation", "open_"),
    [(0.0, 0.05, ()), (0.0, 20.0, ("inertia.I_m",)), (-1e3, 0.05, ("inertia.I_m",))],
    ids=["told", "over a factor of ten", "at its bound"],
)
def test_a_number_that_the_record_leaves_open_is_said_to_be_so(
    z: float, deviation: float, open_: tuple[str, ...]
) -> None:
    """Drawing joints from such an interval would make some of them a hundred times too light."""
    terms = base_terms(Joint(datasheet(), "rigid", "current", {}), SCALES)[:2]
    found = scatter(terms, [z, 0.1], np.diag([deviation**2, 1e-4]))
    shown = tuple(name for name in open_ if name in found.names)
    assert tuple(found.untold(())) == shown
    assert found.untold({"inertia"}) == (set(shown) if deviation > 1.0 else set())
    table = found.table(found.untold(()))
    kept = [name for name in found.names if name not in open_]
    assert list(table["names"]) == kept  # type: ignore[call-overload]
    assert np.shape(table["matrix"]) == (len(kept), len(kept))


def test_the_values_of_the_answer_come_from_more_windows_of_the_same_pieces() -> None:
    case = make_case([record()], [], datasheet(), get_structure("rigid"))
    assert case.fine.count >= 3 * case.fit.count
    _, held = split(case.logs, cut(case.logs))
    starts = np.concatenate([group.starts for group in case.fine.groups])
    assert not any(((piece.start <= starts) & (starts < piece.stop)).any() for piece in held)
    rougher = make_case([record(dry=1.1 * DRY)], [], datasheet(), get_structure("rigid"))
    scales, problem = scales_of(case.joint, case.logs), Problem(case.fit)
    terms = (*base_terms(case.joint, scales), candidates(case.joint, scales, case.logs)[0])
    fit = problem.fit(Model(case.joint, terms))
    found = Found(fit, fit, (), (), ())
    levels = []
    for fine in (case.fine, rougher.fine):
        refined = _finer(replace(case, fine=fine), problem, found).fit
        levels.append(refined.model.values(refined.z)[-1][0])
        assert [e.shape for e in refined.errors] == [e.shape for e in fit.errors]
    assert levels == pytest.approx([DRY, 1.1 * DRY], rel=0.02)


@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_a_number_is_at_its_bound_in_any_unit(unit: float) -> None:
    number = Number("d_m", "N m s/rad", unit, 0.5, True, unit / 3.0, 3.0 * unit)
    assert number.at_bound(number.coordinate(unit / 3.0))
    assert not number.at_bound(number.coordinate(unit / 2.9))
