"""A motor on a dynamometer: another machine holds the speed, and a cell measures the load."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.gap.check import examine
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.torque.inverse import seen_in_torque
from cjt_gym.gap.recorded.orient import all_oriented
from cjt_gym.joint import JointFile, Quantity, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record

NOMINAL, ACTUAL = 0.1, 0.13
"""Torque constant as stated, and as it is [N m/A]."""
ROTOR, DRAG, DT = 1e-4, 4e-4, 2e-3
CELL = 0.2
"""Share by which the torque cell's low pass follows in a sample."""
RIGID = get_structure("rigid")


def motor(tolerance: float | None = 0.05) -> JointFile:
    """Return the datasheet of the motor."""
    values = {
        "I_m": (ROTOR, "kg m^2"), "I_g": (0.0, "kg m^2"), "I_l": (0.0, "kg m^2"),
        "d_m": (0.0, "N m s/rad"), "n": (1.0, "-"),
    }  # fmt: skip
    known = {s: Quantity(x, unit, "test") for s, (x, unit) in values.items()}
    known["k_t"] = Quantity(NOMINAL, "N m/A", "test", tolerance=tolerance)
    return JointFile(JointParameters("dyno", "test", known), {}, drive="current")


def run(seed: int, mu: float = 0.0, *, k_t: float = ACTUAL, way: float | None = None) -> Record:
    """Return 40 s of current steps at speeds that the other machine holds and changes by ramps.

    Args:
        seed: Of currents, speeds and noise.
        mu: Friction of the motor's gear, relative to the torque that it passes on.
        k_t: The motor's torque constant [N m/A].
        way: Direction of all speeds if there is only one; the motor only drives then.
    """
    rng = np.random.default_rng(seed)
    t = DT * np.arange(20_000)
    level = rng.uniform(5.0, 40.0, 20) * (np.where(rng.random(20) < 0.5, -1.0, 1.0))
    current = rng.uniform(-8.0, 8.0, 80)
    if way is not None:
        level, current = way * np.abs(level), way * np.abs(current)
    knots = np.repeat(2.0 * np.arange(20), 2) + np.tile([0.3, 2.0], 20)
    speed = np.interp(t, knots, np.repeat(level, 2))
    speed += 0.2 * np.sin(2.0 * np.pi * 3.0 * t)  # the other machine's controller
    i = current[np.minimum((t / 0.5).astype(int), 79)]
    passed = k_t * i - ROTOR * np.gradient(speed, t) - DRAG * speed
    passed /= 1.0 + mu * np.sign(speed) * np.sign(passed)
    columns = {
        "t": t,
        "dq_m": speed + 0.01 * rng.standard_normal(t.size),
        "i": i + 0.02 * rng.standard_normal(t.size),
        "tau_l": 0.02 * rng.standard_normal(t.size) - lfilter([CELL], [1.0, CELL - 1.0], passed),
    }
    units = {"t": "s", "dq_m": "rad/s", "i": "A", "tau_l": "N m"}
    return Record(columns, units, structure="rigid")


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(run(0, 0.2), motor(), validate=run(1, 0.2))


def test_torque_constant_and_friction_of_the_load_are_named(found: Diagnosis) -> None:
    named = {e.name: e for e in found.effects}
    assert found.verdict == "partly_explained"
    assert named.keys() >= {"torque_constant", "load_friction"}
    assert named["torque_constant"].parameters["k_t"].value == pytest.approx(ACTUAL, rel=0.02)
    assert named["load_friction"].parameters["mu_m"].value == pytest.approx(0.2, rel=0.05)
    assert not {"torque_constant", "load_friction"} & {
        *named["torque_constant"].confusable_with, *named["load_friction"].confusable_with
    }  # fmt: skip


def test_joint_file_has_what_the_torque_shows_and_predicts_no_worse(found: Diagnosis) -> None:
    rows = found.joint.effects
    assert rows["torque_constant"]["k_t"].number == pytest.approx(ACTUAL, rel=0.02)
    assert rows["load_friction"]["mu_m"].number == pytest.approx(0.2, rel=0.05)
    assert "by a regression of the torque" in rows["torque_constant"]["k_t"].source
    assert all(row.found <= row.datasheet for row in found.horizons)
    assert "the joint file has them" in found.unexplained.text


@pytest.mark.parametrize("seed", range(5))
def test_a_right_torque_constant_is_not_corrected(seed: int) -> None:
    case = make_case([run(seed, k_t=1.02 * NOMINAL)], [], motor(), RIGID)
    seen = seen_in_torque(case.joint, case.logs)
    assert not {"torque_constant", "load_friction"} & seen.keys()


@pytest.mark.parametrize("seed", range(5))
def test_both_are_as_large_as_they_are(seed: int) -> None:
    case = make_case([run(seed, 0.1)], [], motor(), RIGID)
    seen = seen_in_torque(case.joint, case.logs)
    assert seen["torque_constant"].values == pytest.approx((ACTUAL,), rel=0.02)
    assert seen["load_friction"].values == pytest.approx((0.1,), rel=0.1)


def test_check_tells_friction_of_the_load_only_where_the_motor_brakes_too() -> None:
    both, one = (examine([run(0, 0.1, way=way)], motor(), RIGID) for way in (None, 1.0))
    assert {"torque_constant", "load_friction"} <= {*both.can_tell}
    assert "torque_constant" in one.can_tell
    assert "load_friction" not in one.can_tell


def test_a_motor_that_only_drives_may_have_either() -> None:
    found = diagnose(run(0, way=1.0), motor(), validate=run(1, way=1.0))
    (effect,) = (e for e in found.effects if e.name == "torque_constant")
    assert effect.parameters["k_t"].value == pytest.approx(ACTUAL, rel=0.03)
    assert "load_friction" in effect.confusable_with


def test_a_load_cell_of_the_wrong_sign_is_turned_and_nothing_else() -> None:
    record = run(0, 0.1)
    wrong = record.with_columns({"tau_l": -record["tau_l"]})
    (turned,), said = all_oriented([wrong], motor(), RIGID)
    np.testing.assert_array_equal(turned["tau_l"], record["tau_l"])
    assert [repair.text.split(":")[0] for repair in said] == ["tau_l"]
    assert all_oriented([record], motor(), RIGID) == ([record], [])
