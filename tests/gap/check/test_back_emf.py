"""A voltage too small for the speed that it is said to drive."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.check import examine
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record

K_T, OHM, INERTIA = 0.05, 2.0, 1e-3


def servo() -> JointFile:
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": K_T, "r": OHM}
    bare = JointParameters.from_values("servo", known | {"v_0": 24.0, "i_p": 20.0})
    return JointFile(bare, structure="rigid", drive="static")


def moved(scale: float) -> Record:
    """Return a motor under changing voltage, which is logged in another unit."""
    dt, fine = 0.01, 10
    t = dt * np.arange(1500)
    volts = 6.0 * np.sin(2.0 * t) + 3.0 * np.sin(5.3 * t)
    q = v = 0.0
    angle = np.zeros(len(t))
    for k, u in enumerate(volts):
        angle[k] = q
        for _ in range(fine):
            v += dt / fine / INERTIA * K_T * (u - K_T * v) / OHM
            q += dt / fine * v
    columns = {"t": t, "v": scale * volts, "q_m": 1e-3 * np.round(1e3 * angle)}
    return Record(columns, {"t": "s", "v": "V", "q_m": "rad"}, structure="rigid")


@pytest.mark.parametrize(("scale", "told"), [(1.0, False), (1e-3, True)])
def test_a_motor_faster_than_its_voltage_is_told(scale: float, told: bool) -> None:
    found = examine(moved(scale), servo(), get_structure("rigid"))
    assert any("the motor induces" in fault for fault in found.faults) == told
