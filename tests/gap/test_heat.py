"""A motor that weakens as it warms, over a log of a minute, simulated here in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

INERTIA, DAMPING, DRY, K_T = 2.5e-3, 4e-3, 0.03, 0.25
FINE, EVERY, SECONDS = 1e-3, 10, 60.0


def record(lost: float, seed: int = 0) -> Record:
    """Return 100 Hz rows of a 1 kHz position loop; the motor loses torque as it warms."""
    rng = np.random.default_rng(seed)
    t = FINE * np.arange(round(SECONDS / FINE))
    wanted = sum(a * np.sin(w * t) for a, w in ((0.7, 6.9), (0.5, 11.9), (0.3, 17.0)))
    pace = np.gradient(wanted, FINE)
    q = v = warm = 0.0
    rows = []
    for k in range(len(t)):
        i = 20.0 * (wanted[k] - q) + 0.4 * (pace[k] - v)
        if k % EVERY == 0:
            rows.append((t[k], i, q))
        warm += FINE / 12.5 * (i * i - warm)
        torque = K_T * (1.0 - lost * warm) * i
        free = v + FINE / INERTIA * (torque - DAMPING * v)
        v = np.sign(free) * max(abs(free) - FINE / INERTIA * DRY, 0.0)
        q += FINE * v
    table = np.array(rows).T
    columns = {"t": table[0], "i": table[1] + 0.02 * rng.standard_normal(table.shape[1])}
    columns["q_m"] = np.round(table[2] / 4e-4) * 4e-4
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")


def sheet() -> JointFile:
    """Return what is known of the joint, with tolerances."""
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": DAMPING, "n": 1.0, "k_t": K_T}
    bare = JointParameters.from_values("motor", known)
    stated = {
        "I_m": Quantity(INERTIA, "kg m^2", "sheet", 0.03),
        "d_m": Quantity(DAMPING, "N m s/rad", "sheet", 0.2),
        "k_t": Quantity(K_T, "N m/A", "sheet", 0.03),
        "d_cm": Quantity(DRY, "N m", "sheet", 0.2),
    }
    return JointFile(bare.replace(**stated), effects={"coulomb": {}})


@pytest.mark.slow
@pytest.mark.parametrize("lost", [0.0, 0.15])
def test_a_loss_of_a_seventh_over_a_minute_is_named(lost: float) -> None:
    found = diagnose(record(lost), sheet())
    named = {effect.name: effect for effect in found.effects}
    if not lost:
        assert found.verdict == "no_gap"
        return
    assert "thermal_derating" in named
    assert not {name for name, one in named.items() if one.status == "confirmed"} & {
        "inertia", "torque_constant", "damping",
    }  # fmt: skip
    assert found.gap.after < 0.1 * found.gap.before
