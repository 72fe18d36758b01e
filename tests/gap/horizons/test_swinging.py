"""A pendulum that a small torque hardly drives, in rows of uncertain instants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

DT, LATE, INNER = 0.01, 8e-3, 20
INERTIA, WEIGHT, DAMPING, K_T = 0.0225, 0.245, 1e-3, 0.025


def pendulum() -> Record:
    """Return rows of 100 Hz, each read up to a few milliseconds late."""
    rng = np.random.default_rng(3)
    t = DT * np.arange(3000)
    i = np.sin(2.0 * np.pi * (0.1 + 0.03 * t) * t)
    q, v, h, angle = 0.3, 0.0, DT / INNER, np.zeros((len(t), INNER))
    for k, current in enumerate(i):
        for m in range(INNER):
            angle[k, m] = q
            v += h / INERTIA * (K_T * current - WEIGHT * np.sin(q) - DAMPING * v)
            q += h * v
    instants = rng.integers(0, round(LATE / h), len(t))
    read = angle[np.arange(len(t)), instants]
    noisy = i + 0.2 * rng.standard_normal(len(t))
    columns = {"t": t, "i": noisy, "q_m": np.round(read / 3e-4) * 3e-4}
    return Record(columns, {"t": "s", "i": "A", "q_m": "rad"}, structure="rigid")


def guess() -> JointFile:
    """Return a joint file whose inertia is a guess."""
    known = {"I_m": 0.01, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": K_T}
    bare = JointParameters.from_values("pendulum", known)
    stated = {
        "I_m": Quantity(known["I_m"], "kg m^2", "guess"),
        "k_t": Quantity(K_T, "N m/A", "sheet", 0.1),
    }
    return JointFile(bare.replace(**stated), structure="rigid", drive="static")


@pytest.mark.slow
def test_its_weight_is_named_though_a_regression_of_the_torque_hides_it() -> None:
    found = diagnose(pendulum(), guess())
    (weight,) = (e for e in found.effects if e.name == "gravity")
    assert weight.parameters["torque"].value == pytest.approx(WEIGHT, rel=0.15)
    assert weight.status == "tentative"


def test_a_pendulum_without_a_motor_has_the_weight_that_its_inertia_is_sure_of() -> None:
    t, off = DT * np.arange(2000), 1.06
    w = np.sqrt(WEIGHT / INERTIA)
    q = 0.3 * np.exp(-0.02 * t) * np.cos(w * t)
    columns = {"t": t, "tau_cmd": np.zeros(len(t)), "q_m": np.round(q / 1e-4) * 1e-4}
    record = Record(columns, {"t": "s", "tau_cmd": "N m", "q_m": "rad"}, structure="rigid")
    file = guess()
    stated = Quantity(off * INERTIA, "kg m^2", "sheet", 0.05)
    found = diagnose(record, replace(file, parameters=file.parameters.replace(I_m=stated)))
    (weight,) = (e for e in found.effects if e.name == "gravity")
    torque = weight.parameters["torque"]
    assert torque.value == pytest.approx(off * WEIGHT, rel=0.02)
    assert torque.low < WEIGHT < torque.high
    assert 0.15 < (torque.high - torque.low) / torque.value < 0.7
