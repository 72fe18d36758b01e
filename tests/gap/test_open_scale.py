"""Friction of a joint whose torque constant and inertia are guesses: there, but of open size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.stages.intervals import at_known, is_there, known_to_a_factor
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record
from tests.gap.simulator import TRUE, nominal, simulate

DRY = 6.0
"""Friction of the simulated mass [N m]."""


def test_a_number_beside_another_that_is_known_is_as_sure_as_its_regression_on_that() -> None:
    one, both, other = 4.0, 1.8, 1.0
    matrix = np.array([[one, both], [both, other]])
    left = at_known(matrix, [1])
    np.testing.assert_allclose(left, [[one - both**2 / other, 0.0], [0.0, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(at_known(matrix, []), matrix)


@pytest.mark.parametrize(
    ("value", "half", "own", "there"),
    [
        (1.0, 4.0, 0.1, True),  # any size, but not none
        (-1.0, 4.0, 0.1, True),
        (1.0, 4.0, 1.5, False),  # it may be nothing at any scale
        (1.0, 0.3, 0.2, False),  # its own scatter counts as much
    ],
)
def test_what_only_the_scale_leaves_open_is_there(
    value: float, half: float, own: float, there: bool
) -> None:
    assert is_there(value, half, own) is there


def test_a_number_known_to_a_factor_has_ends_at_the_same_ratio() -> None:
    low, high = known_to_a_factor(2.0, 0.02)
    assert (low, high) == pytest.approx((1.98, 2.02), rel=1e-4)  # as at the same distance
    assert known_to_a_factor(2.0, 100.0) == pytest.approx([0.2, 20.0])
    assert known_to_a_factor(-2.0, 100.0) == pytest.approx([-20.0, -0.2])


@pytest.mark.slow
@pytest.mark.parametrize("channel", ["i", "i_cmd"])
def test_guesses_of_the_scale_of_all_torques_do_not_hide_friction(channel: str) -> None:
    file, units = nominal(), nominal().parameters.quantities
    vague = {s: Quantity(TRUE[s], units[s].unit, "guess", 2.0) for s in ("I_m", "k_t")}
    vague["d_m"] = Quantity(0.0, units["d_m"].unit, "not stated")
    file = replace(file, parameters=file.parameters.replace(**vague), sensors={})
    moved = simulate(seconds=14.0, friction=(DRY, DRY), spring=lambda _: 0.0)
    columns = {"t": moved.t, "q_m": moved["q_m"], channel: moved[channel]}
    units_of = {"t": "s", "q_m": "rad", channel: "A"}
    found = diagnose(Record(columns, units_of, structure="rigid"), file)
    named = {e.name: e for e in found.effects}
    assert named.keys() == {"coulomb", "damping"}
    for name, symbol, true in (("coulomb", "d_cm", DRY), ("damping", "d_m", TRUE["d_m"])):
        one = named[name].parameters[symbol]
        assert named[name].status == "confirmed"
        assert 0.05 * one.value <= one.low < true < one.high <= 20.0 * one.value
        listed = found.joint.effects[name][symbol]
        assert isinstance(listed, Quantity)
        assert listed.low is not None
        assert listed.low == pytest.approx(one.low, rel=1e-6)
