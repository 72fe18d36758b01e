"""Two discs on a shaft, of which two angles and no torque are known, simulated in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.prediction.log import to_log
from cjt_gym.gap.recorded.driven import driven_only
from cjt_gym.joint import JointFile, Quantity, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record

LOWER, UPPER, SHAFT = 0.011, 0.0097, 2.7
"""Inertias of the two discs [kg m^2], and stiffness of the shaft between them [N m/rad]."""
DRY, ZERO, FINE, EVERY = 0.03, 0.4, 1e-4, 100
"""Dry friction of the lower disc [N m], zero of the upper encoder [rad], time step of the
simulation [s], and its steps in a row of the log."""
SHAPE = get_structure("rigid_gearbox")


def discs(way: float, hertz: float = 2.0, load: float = 0.0) -> Record:
    """Return 12 s under a speed controller, then 3 s without power.

    Args:
        way: 1 for motion in one direction only, 0 for both alike.
        hertz: Frequency that is added to the speed wanted.
        load: Dry friction of the upper disc [N m].
    """
    q, dq, u, rows = np.zeros(2), np.zeros(2), 0.0, []
    inertia, dry = np.array([LOWER, UPPER]), np.array([DRY, load])
    for k in range(150_000):
        t = k * FINE
        if k % EVERY == 0:
            wanted = 6.0 * way + 3.0 * np.sin(2.0 * np.pi * hertz * t)
            wanted += 6.0 * (1.0 - way) * np.sin(2.0 * np.pi * 0.4 * t)
            u = float(np.clip(0.1 * (wanted - dq[0]), -0.6, 0.6)) if t < 12.0 else 0.0
            rows.append((t, q[0], u, q[1] + ZERO))
        twist = SHAFT * (q[0] - q[1])
        free = dq + FINE / inertia * np.array([u - twist, twist])
        dq = np.sign(free) * np.maximum(np.abs(free) - FINE / inertia * dry, 0.0)
        q = q + FINE * dq
    return _record(rows, 2.0 * np.pi / 16_000)


def _record(rows: list[tuple[float, ...]], step: float) -> Record:
    """Return rows of time, lower angle, torque and upper angle, read by encoders of a step."""
    t, lower, torque, upper = np.array(rows).T
    columns = {
        "t": t, "q_m": step * np.round(lower / step), "tau_cmd": torque,
        "q_l": step * np.round(upper / step),
    }  # fmt: skip
    units = {"t": "s", "q_m": "rad", "tau_cmd": "N m", "q_l": "rad"}
    return Record(columns, units, structure=SHAPE.name)


def datasheet() -> JointFile:
    """Return the discs' datasheet, with a guess of the shaft's stiffness."""
    values = {
        "I_m": (0.0115, "kg m^2", 0.15), "I_g": (0.0, "kg m^2", None),
        "I_l": (0.0095, "kg m^2", 0.1),
        "d_m": (0.0, "N m s/rad", None), "d_l": (0.0, "N m s/rad", None),
        "n": (1.0, "-", None), "k_t": (1.0, "N m/A", 0.05),
    }  # fmt: skip
    known = {s: Quantity(x, unit, "test", tolerance=t) for s, (x, unit, t) in values.items()}
    known["k_b"] = Quantity(2.3, "N m/rad", "test", guess=True)
    return JointFile(JointParameters("discs", "test", known), {}, drive="current")


@pytest.mark.parametrize("way", [0.0, 1.0])
def test_zero_of_the_twist_is_that_without_torque_and_not_without_input(way: float) -> None:
    record = discs(way)
    log = to_log(record, datasheet(), SHAPE)
    zero = log.measured["q_l"] - (record["q_l"] - ZERO)
    assert np.abs(zero).max() < 2e-3


def test_a_disc_that_drives_the_other_is_nothing_from_outside() -> None:
    record = discs(1.0)
    assert driven_only([record], SHAPE) == ((record,), ())


@pytest.mark.slow
def test_friction_and_shaft_are_found() -> None:
    found = diagnose([discs(1.0), discs(1.0, 3.0)], datasheet(), validate=discs(1.0, 4.0))
    named = {e.name: e for e in found.effects}
    assert named["coulomb"].parameters["d_cm"].value == pytest.approx(DRY, rel=0.1)
    ahead = [row for row in found.horizons if row.seconds >= 0.1]
    assert all(row.found < 0.3 * row.datasheet for row in ahead if row.seconds == 0.5)
    assert all(row.found < 0.1 for row in ahead)


@pytest.mark.slow
@pytest.mark.parametrize("way", [0.0, 1.0])
def test_motion_in_one_direction_confirms_no_friction_of_the_load(way: float) -> None:
    records = [discs(way, hertz, load=0.01) for hertz in (2.0, 3.0, 4.0)]
    found = diagnose(records[:2], datasheet(), validate=records[2])
    load = [e for e in found.effects if e.name == "load_coulomb"]
    assert all(e.status == "tentative" for e in load) or way == 0.0
    if way == 0.0:
        assert load[0].parameters["d_cl"].value == pytest.approx(0.01, rel=0.2)


WEIGHT = 0.5
"""Weight that hangs from the upper disc [N m]."""


def swings(start: float) -> Record:
    """Return 10 s of swings over less than 0.4 rad, driven by a chirp from `start` [Hz]."""
    q, dq, u, rows = np.zeros(2), np.zeros(2), 0.0, []
    inertia = np.array([LOWER, UPPER])
    for k in range(100_000):
        t = k * FINE
        if k % EVERY == 0:
            u = 0.025 * float(np.sin(2.0 * np.pi * (start + 0.25 * t) * t))
            rows.append((t, q[0], u, q[1]))
        twist = SHAFT * (q[0] - q[1])
        pull = np.array([u - twist, twist - WEIGHT * np.sin(q[1])]) - 2e-3 * dq
        dq = dq + FINE * pull / inertia
        q = q + FINE * dq
    return _record(rows, 2.0 * np.pi / 200_000)


@pytest.mark.slow
def test_a_weight_that_check_says_the_record_shows_is_named_over_a_small_angle() -> None:
    """Its torque is not measured, and the regression of the motor's torque does not see it."""
    record = swings(0.3)
    assert np.ptp(record["q_l"]) < 0.4
    found = diagnose(record, datasheet(), validate=swings(0.5))
    assert "gravity" in found.examination.can_tell
    (weight,) = (e for e in found.effects if e.name == "gravity")
    torque = weight.parameters["torque"]
    assert torque.low < WEIGHT < torque.high
    ratio = torque.value / found.joint.parameters.k_t
    assert ratio == pytest.approx(WEIGHT / 1.0, rel=0.02)  # known in proportion only
    assert weight.status == "tentative"
