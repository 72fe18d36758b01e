"""Two angles that are read at different instants, and a spring that winds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap.check import examine
from cjt_gym.gap.check.encoders import angles_in_step, late_angle
from cjt_gym.gap.check.view import View
from cjt_gym.gap.horizons.prediction.model import quiet
from cjt_gym.joint import JointFile, get_structure, load_joint
from cjt_gym.records import Record

SHAPE = get_structure("rigid_gearbox")
DT, STIFF = 4e-3, 6e4


def two_angles(late: float, *, stiffness: float = STIFF, torque: bool = False) -> Record:
    """Return a record of a joint with an angle on either side of its spring.

    Args:
        late: By how much the load's angle is read later [s].
        stiffness: Of the spring [N m/rad].
        torque: Whether its torque is measured, too.
    """
    joint = load_joint("orange_80_6000", SHAPE.name, parameters={"k_b": stiffness, "I_l": 1.0})
    t = 1e-3 * np.arange(8000)
    drive = 20.0 * np.sin(2.0 * np.pi * 0.4 * t) + 8.0 * np.sin(2.0 * np.pi * 1.1 * t)
    made = quiet(joint).simulate(drive, dt=1e-3)
    rows = np.arange(0, len(t) - 40, 4)
    columns = {
        "t": t[rows],
        "i": (drive / (joint.parameters.k_t * joint.parameters.n))[rows],
        "q_m": made["true_q_m"][rows],
        "q_l": np.interp(t[rows] - late, t, made["true_q_l"]),
    }
    units = {"t": "s", "i": "A", "q_m": "rad", "q_l": "rad"}
    if torque:
        columns["tau"], units["tau"] = made["true_tau"][rows], "N m"
    return Record(columns, units, structure=SHAPE.name)


def sheet() -> JointFile:
    file = load_joint("orange_80_6000", SHAPE.name).file
    return replace(file, parameters=file.parameters.replace(k_b=STIFF, I_l=1.0))


def lateness(record: Record) -> float:
    return late_angle(View.of([record], sheet(), SHAPE))


@pytest.mark.parametrize("torque", [False, True])
@pytest.mark.parametrize("late", [-3e-3, 3e-3, 10e-3])
def test_an_angle_that_is_read_late_is_found(late: float, torque: bool) -> None:
    assert lateness(two_angles(late, torque=torque)) == pytest.approx(late, rel=0.1)


def test_a_measured_torque_shows_it_even_at_a_soft_spring() -> None:
    assert lateness(two_angles(2e-3, stiffness=3e3, torque=True)) == pytest.approx(2e-3, rel=0.1)


@pytest.mark.parametrize("torque", [False, True])
@pytest.mark.parametrize("stiffness", [STIFF, 0.5 * STIFF, 3e3])
def test_a_spring_that_winds_is_not_taken_for_it(stiffness: float, torque: bool) -> None:
    assert lateness(two_angles(0.0, stiffness=stiffness, torque=torque)) == 0.0


def test_a_gearbox_that_winds_by_its_friction_is_not_taken_for_it() -> None:
    joint = load_joint("orange_80_6000", "full_dynamics", parameters={"d_g": 40.0, "k_g": 8e3})
    t = 1e-3 * np.arange(8000)
    drive = 20.0 * np.sin(2.0 * np.pi * 0.4 * t) + 8.0 * np.sin(2.0 * np.pi * 1.1 * t)
    made = quiet(joint).simulate(drive, dt=1e-3)
    current = drive / (joint.parameters.k_t * joint.parameters.n)
    columns = {"t": t, "i": current, **{n: made[f"true_{n}"] for n in ("q_m", "q_l", "tau")}}
    units = {"t": "s", "i": "A", "q_m": "rad", "q_l": "rad", "tau": "N m"}
    record = Record(columns, units, structure="full_dynamics")
    assert late_angle(View.of([record], joint.file, get_structure("full_dynamics"))) == 0.0


def test_the_fault_is_told_and_mended() -> None:
    record = two_angles(3e-3)
    told = [text for text in examine(record, sheet(), SHAPE).faults if "q_l follows q_m" in text]
    assert len(told) == 1
    assert "0.75 samples (3 ms)" in told[0]
    (mended,), (held,) = angles_in_step([record], [two_angles(3e-3, stiffness=3e3)], sheet(), SHAPE)
    assert len(held) == len(mended)
    with_speed = record.with_columns(
        {"dq_l": np.gradient(record["q_l"], record.t)}, {"dq_l": "rad/s"}
    )
    (moved,), _ = angles_in_step([with_speed], [], sheet(), SHAPE)
    assert moved["dq_l"][5:-5] == pytest.approx(np.gradient(moved["q_l"], DT)[5:-5], abs=1e-2)
    fresh = two_angles(0.0)
    assert len(record) - 1 <= len(mended) <= len(record)
    assert mended["q_l"] == pytest.approx(fresh["q_l"][: len(mended)], abs=1e-4)
    assert angles_in_step([fresh], [], sheet(), SHAPE) == ([fresh], [])
