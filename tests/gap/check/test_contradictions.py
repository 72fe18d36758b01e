"""Channels that contradict each other, or the spring and the gear of the joint."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap.check import examine
from cjt_gym.joint import get_structure
from tests.gap.check.moved import columns, joint, record
from tests.gap.simulator import nominal, simulate


def test_angles_that_differ_by_the_gear_are_found() -> None:
    table = columns()
    table["q_l"] = 50.0 * table["q_m"]
    geared = joint(n=50.0, k_b=1e5, k_t=0.002, I_l=0.001)
    found = examine(record(table), geared, get_structure("rigid")).faults
    assert any("q_l is 50 times q_m, the ratio n of the gear" in fault for fault in found)


def test_a_torque_against_its_spring_is_found() -> None:
    held = get_structure("output_fixed_rigid_gearbox")
    sound, odd = nominal(), nominal(k_b=0.3)
    said = "times the nominal stiffness times the deflection"
    rec = simulate(friction=(1.5, 1.5))
    assert not any(said in fault for fault in examine(rec, sound, held).faults)
    assert any("tau is 3.33 " + said in fault for fault in examine(rec, odd, held).faults)
    other = {**rec.columns, "q_m": rec["tau"], "tau": rec["q_m"]}
    swapped = examine(replace(rec, columns=other), sound, held).faults
    assert any("as if q_m and tau were swapped" in fault for fault in swapped)


def test_a_joint_that_turns_freely_is_not_taken_for_one_with_a_held_output() -> None:
    held = get_structure("output_fixed_rigid_gearbox")
    rec = simulate(friction=(1.5, 1.5))
    turned = {**rec.columns, "q_m": 40.0 * rec["q_m"]}
    turned.pop("tau")
    free = replace(rec, columns=turned, units={n: rec.units[n] for n in turned if n != "t"})
    said = "the output is free (choose such a structure)"
    assert not any(said in fault for fault in examine(rec, nominal(), held).faults)
    assert any(said in fault for fault in examine(free, nominal(), held).faults)


@pytest.mark.parametrize(("wrong", "said"), [(1.5, False), (4.0, True), (0.25, True)])
def test_a_torque_constant_that_is_not_the_sensor_s_is_found(wrong: float, said: bool) -> None:
    """The range that is told holds the true factor."""
    held = get_structure("output_fixed_rigid_gearbox")
    sheet = nominal(k_t=wrong)
    told = [f for f in examine(simulate(friction=(1.5, 1.5)), sheet, held).faults if "k_t, n" in f]
    assert bool(told) == said
    for fault in told:
        ends = [float(x) for x in re.findall(r"([0-9.]+) (?:to|times)", fault)]
        assert 0.9 * min(ends) < 1.0 / wrong < 1.1 * max(ends)


def test_a_turned_torque_has_no_other_scale() -> None:
    held = get_structure("output_fixed_rigid_gearbox")
    made = simulate(friction=(1.5, 1.5))
    turned = replace(made, columns={**made.columns, "tau": -made["tau"]})
    assert not any("k_t, n" in fault for fault in examine(turned, nominal(), held).faults)


@pytest.mark.parametrize("most", [0.5, 1.0, 2.0])
def test_a_current_that_is_limited_has_no_other_scale(most: float) -> None:
    table = columns()
    limited = table | {"i": np.clip(table["i"], -most, most)}
    assert not any(
        " times i_cmd" in fault for fault in examine(record(limited), joint(), None).faults
    )
