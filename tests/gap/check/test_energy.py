"""A joint that a hand moves as well, simulated here in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.errors import RecordError
from cjt_gym.gap import diagnose
from cjt_gym.gap.check.energy import foreign
from cjt_gym.gap.check.examine import examine
from cjt_gym.gap.check.faults import OTHERS
from cjt_gym.gap.check.view import View
from cjt_gym.gap.recorded.orient import orient
from cjt_gym.joint import get_structure
from cjt_gym.records import Record
from tests.gap.horizons.rotor import datasheet

DT, INERTIA, DAMPING, DRY = 2e-3, 0.02, 0.02, 0.05


def servo(hand: float, weight: float = 0.0, stiffness: float = 0.5) -> Record:
    """Return a record of a joint under position control.

    Args:
        hand: Size of the torque of a hand that pushes to and fro [N m].
        weight: Largest torque of a weight [N m].
        stiffness: Gain of the controller [N m/rad].
    """
    rng = np.random.default_rng(5)
    t = np.arange(15_000) * DT
    wanted = 0.9 * np.sin(1.7 * t) + 0.4 * np.sin(4.1 * t)
    pushes = hand * np.interp(t, np.arange(0.0, 31.0, 0.4), rng.standard_normal(78))
    q = v = 0.0
    angle, current = np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t)):
        angle[k] = q
        current[k] = i = stiffness * (wanted[k] - q) - 0.05 * v + weight * np.sin(q)
        free = v + DT / INERTIA * (i + pushes[k] - DAMPING * v - weight * np.sin(q))
        v = np.sign(free) * max(abs(free) - DT / INERTIA * DRY, 0.0)
        q += DT * v
    columns = {"t": t, "i": current + 0.01 * rng.standard_normal(len(t)), "q_m": angle}
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")


@pytest.mark.parametrize("weight", [0.0, 1.5])
def test_a_motor_gives_all_that_its_joint_gains(weight: float) -> None:
    assert foreign(View.of([servo(0.0, weight)], None, None)) == []


@pytest.mark.slow
def test_a_hand_gives_more() -> None:
    record = servo(0.8)
    (said,) = foreign(View.of([record], None, None))
    assert "energy that its motor does not give" in said
    exam = examine(record, datasheet(1.0), None)
    assert said in exam.faults
    assert OTHERS in exam.advice
    found = diagnose(record, datasheet(1.0))
    assert "Something other than the motor moves the joint" in found.unexplained.text
    assert not any(effect.status == "confirmed" for effect in found.effects)


def test_a_current_of_the_wrong_sign_is_no_hand() -> None:
    record = servo(0.0)
    turned = record.with_columns({"i": -record["i"]})
    assert foreign(View.of([turned], datasheet(1.0), None)) == []
    (said,) = foreign(View.of([turned], None, None))  # without a joint, no sign is judged
    assert said.endswith("or the sign of i is wrong.")


def test_a_push_that_was_measured_is_none() -> None:
    record = servo(0.8)
    known = Record(
        {**record.columns, "tau_l": np.sin(record.t)}, {**record.units, "tau_l": "N m"},
        structure="rigid",
    )  # fmt: skip
    assert foreign(View.of([known], None, None)) == []


@pytest.mark.parametrize(("i", "said"), [(0.0, "i is 0 throughout"), (-2e-4, "i never changes")])
def test_a_joint_that_moves_without_an_input_is_moved_by_another(i: float, said: str) -> None:
    record = servo(0.0)
    off = record.with_columns({"i": np.full(len(record), i)})
    (found,) = foreign(View.of([off], None, None))
    assert found.startswith(f"{said}, and the joint gains speed again and again")
    with pytest.raises(RecordError, match="something other than the motor drives the joint"):
        diagnose(off, datasheet())


@pytest.mark.parametrize("slowing", [0.1, 0.005])
def test_a_pendulum_that_swings_down_gains_nothing(slowing: float) -> None:
    t = DT * np.arange(15000)
    late = 5e-4 * np.random.default_rng(3).standard_normal(len(t))
    angle = np.exp(-slowing * t) * np.cos(5.0 * (t + late))
    counts = 2.0 * np.pi / 14400.0
    columns = {"t": t, "i": np.zeros(len(t)), "q_m": counts * np.round(angle / counts)}
    swinging = Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")
    assert foreign(View.of([swinging], None, None)) == []


def by_voltage(turn: float = 1.0) -> Record:
    """Return a motor driven by voltage through a resistance of 1 Ohm."""
    rng = np.random.default_rng(1)
    t = DT * np.arange(15000)
    v = 3.0 * np.interp(t, np.arange(0.0, 31.0, 0.4), rng.standard_normal(78))
    q = dq = 0.0
    angle = np.zeros(len(t))
    for k in range(len(t)):
        angle[k] = q
        dq += DT / INERTIA * (v[k] - (1.0 + DAMPING) * dq - DRY * np.tanh(50.0 * dq))
        q += DT * dq
    columns = {"t": t, "v": turn * v, "q_m": angle}
    return Record(columns, {"t": "s", "v": "V", "q_m": "rad"}, structure="rigid")


def test_a_voltage_gives_all_that_its_joint_gains() -> None:
    assert foreign(View.of([by_voltage()], None, None)) == []
    (said,) = foreign(View.of([by_voltage(-1.0)], None, None))
    assert said.endswith("or the sign of v is wrong.")


def test_a_voltage_of_the_wrong_sign_turns_the_angle() -> None:
    joint = datasheet(1.0)
    for turn, turned in ((1.0, []), (-1.0, ["q_m"])):
        _, repairs = orient(by_voltage(turn), joint, get_structure("rigid"))
        assert [repair.channel for repair in repairs if repair.changed] == turned
