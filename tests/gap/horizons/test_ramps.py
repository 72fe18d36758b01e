"""Slow ramps of voltage, which tell friction but no inertia, tested on steps that do."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

DT, FINE = 0.02, 400
RATIO, K_T, R, INERTIA, DAMPING, DRY = 10.0, 0.018, 0.1, 0.02, 0.02, 0.35


def turned(volts: Floats) -> Record:
    """Return rows of a turret whose motor follows a voltage, integrated with fine steps."""
    q = v = 0.0
    angle, h = np.zeros(len(volts)), DT / FINE
    for k, volt in enumerate(volts):
        angle[k] = q
        for _ in range(FINE):
            torque = RATIO * K_T / R * (volt - RATIO * K_T * v) - DAMPING * v
            free = v + h * torque / INERTIA
            v = free - np.clip(free, -h * DRY / INERTIA, h * DRY / INERTIA)
            q += h * v
    columns = {"t": DT * np.arange(len(volts)), "q_m": np.round(angle / 1.5e-3) * 1.5e-3}
    units = {"t": "s", "q_m": "rad", "v": "V"}
    return Record(columns | {"v": volts}, units, structure="rigid")


def sheet() -> JointFile:
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": 0.01, "n": RATIO, "k_t": K_T, "r": R}
    stated = {
        "I_m": Quantity(INERTIA, "kg m^2", "drawing", guess=True),
        "d_m": Quantity(0.01, "N m s/rad", "guess", guess=True),
        "k_t": Quantity(K_T, "N m/A", "sheet", 0.05),
        "r": Quantity(R, "Ohm", "sheet", 0.1),
        "v_0": Quantity(12.0, "V", "battery"),
    }
    bare = JointParameters.from_values("turret", known).replace(**stated)
    sensors = {"q_m": {"resolution": Quantity(1.5e-3, "rad")}}
    return JointFile(bare, sensors=sensors, structure="rigid", drive="static")


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    ramp = 0.25 * DT * np.arange(1200)
    steps = np.repeat([0.0, 4.0, 0.0, -4.0, 0.0, 7.0, 3.0, -6.0, 0.0, 2.0], 60)
    return diagnose([turned(ramp), turned(-ramp)], sheet(), validate=turned(steps))


@pytest.mark.slow
def test_friction_of_ramps_is_found_though_steps_need_an_inertia(found: Diagnosis) -> None:
    (dry,) = (e for e in found.effects if e.name == "coulomb")
    assert dry.parameters["d_cm"].value == pytest.approx(DRY, rel=0.15)
    row = next(row for row in found.horizons if row.seconds == 0.5)
    assert row.found < 0.5 * row.datasheet
    assert found.verdict != "no_gap"
