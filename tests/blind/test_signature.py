"""How large the trace of an effect is said to be, and the rest from which a record begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.blind.case import settled
from cjt_gym.blind.plant import STRUCTURES
from cjt_gym.blind.signature import VISIBLE, active
from tests.blind.joints import PLANT, short, world


def signature(effect: str, strength: float = 1.0, structure: str = "rigid_gearbox") -> float:
    label = short(6, effect, strength, structure).label
    assert set(label["signature"]) == {effect}
    return float(label["signature"][effect])


@pytest.mark.parametrize("effect", ["coulomb", "noise", "creep", "missing_counts"])
def test_trace_grows_with_the_effect(effect: str) -> None:
    assert signature(effect, 0.0) < 1.0
    assert signature(effect) > VISIBLE


def test_trace_within_the_tolerance_is_invisible() -> None:
    """However clean the record, a value within its tolerance is what the datasheet says."""
    assert signature("stiffness") > VISIBLE
    assert signature("stiffness", 0.1) < VISIBLE


def test_constant_torque_is_told_from_an_arbitrary_zero() -> None:
    locked = "output_fixed_rigid_gearbox"
    assert signature("torque_offset", structure=locked) > VISIBLE
    assert signature("torque_bias", structure=locked) > VISIBLE


@pytest.mark.parametrize("structure", STRUCTURES)
def test_only_what_moves_has_a_tolerance(structure: str) -> None:
    names = active(STRUCTURES[structure])
    assert ("k_g" in names) == STRUCTURES[structure].gear_is_soft
    assert ("k_b" in names) == STRUCTURES[structure].bar_is_soft
    assert ("I_l" in names) != STRUCTURES[structure].is_locked


@pytest.mark.parametrize("structure", ["output_fixed", "output_fixed_rigid_gearbox"])
def test_locked_joint_begins_where_it_rests(structure: str) -> None:
    """The bar carries the offset, and the gear winds up by its share."""
    torque = 3.0
    start = settled(world(structure, PLANT._replace(torque_offset=torque))).start
    assert start["twist"] == pytest.approx(torque / PLANT.k_b, rel=1e-3)
    wind = torque / PLANT.k_g if structure == "output_fixed" else 0.0
    assert start["wind"] == pytest.approx(wind, rel=1e-3, abs=1e-12)


def test_free_joint_is_let_go() -> None:
    joint = world("rigid_gearbox", PLANT._replace(torque_offset=3.0))
    assert settled(joint) is joint
    moving = replace(world("output_fixed"), start={"twist": 1e-3})
    assert settled(moving) is moving


def test_offset_does_not_swing_the_record() -> None:
    case = short(6, "torque_offset")
    rest = case.diagnose.columns["tau"][:450]
    assert np.std(rest) < 4.0 * case.sheet.noise[4]
