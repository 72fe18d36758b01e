"""What `examine` says of a measured torque: at rest, and where no spring could pass it on."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.check import examine
from cjt_gym.joint import get_structure
from tests.gap.check.moved import BOTH, DT, K_T, columns, joint, record
from tests.gap.simulator import nominal, simulate

HELD = get_structure("output_fixed_rigid_gearbox")


@pytest.mark.parametrize(
    ("offset", "said"),
    [
        (0.0, "its zero is correct within 0.0"),
        (0.7, "its zero is off if the spring is relaxed then"),
    ],
)
def test_rest_shows_the_zero_of_the_torque_sensor(offset: float, said: str) -> None:
    rec = simulate(friction=(1.5, 1.5), sensed=lambda tau: tau + offset)
    notes = [note for note in examine(rec, nominal(), HELD).notes if "At rest" in note]
    assert len(notes) == 1
    assert said in notes[0]


def test_without_rest_the_zero_of_the_torque_sensor_is_asked_for() -> None:
    rec = simulate(friction=(1.5, 1.5))
    rec = rec.with_columns({"i": rec["i"] + 1.0, "i_cmd": rec["i_cmd"] + 1.0})
    notes = examine(rec, nominal(), HELD).notes
    assert any("Begin with half a second of rest with the spring relaxed" in n for n in notes)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_torque_on_a_rigid_joint_is_the_loads_where_it_explains_the_motion(sign: int) -> None:
    table = columns(BOTH)
    brake = 0.3 * np.sin(2.0 * np.pi * 3.1 * np.arange(len(table["t"])) * DT)
    table["i"] = table["i"] + brake / K_T
    found = examine(record(table | {"tau": -sign * brake}), joint(), None).notes
    assert any(f"map it as tau_l with sign = {sign}" in note for note in found), found


def test_a_torque_on_a_rigid_joint_that_explains_nothing_is_not_used_and_that_is_said() -> None:
    table = columns(BOTH)
    noise = np.random.default_rng(0).normal(0.0, 0.1, len(table["t"]))
    found = examine(record(table | {"tau": noise}), joint(), None).notes
    assert any("tau is not used: the structure rigid has no spring" in note for note in found)
    loaded = examine(record(table | {"tau": noise, "tau_l": noise}), joint(), None).notes
    assert not any("tau is not used" in note for note in loaded)
