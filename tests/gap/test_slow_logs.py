"""Logs slower than the loop that wrote them, simulated here in plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.check import examine
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

FINE, EVERY = 1e-3, 5
INERTIA, DAMPING, K_T, R, RATIO = 0.4, 0.8, 0.05, 0.6, 50.0


def by_voltage(damping: float, k_t: float = K_T) -> Record:
    """Return 200 Hz rows of a geared joint whose voltage a 1 kHz loop sets."""
    t = FINE * np.arange(16_000)
    waves = (
        (0.5, 1.9, 0.3),
        (0.3, 4.4, 1.1),
        (0.15, 8.2, 2.0),
        (0.06, 20.7, 0.4),
        (0.02, 29.5, 5.0),
    )
    wanted = sum(a * (np.sin(w * t + p) - np.sin(p)) for a, w, p in waves)
    pace = np.gradient(wanted, FINE)
    gain, q, v, rows = RATIO * k_t, 0.0, float(pace[0]), []
    for k in range(len(t)):
        torque = 120.0 * (wanted[k] - q) + 9.0 * (pace[k] - v)
        volts = R * torque / gain + gain * v
        if k % EVERY == 0:
            rows.append((t[k], volts, q))
        for _ in range(5):
            push = gain * (volts - gain * v) / R
            v += 0.2 * FINE / INERTIA * (push - damping * v)
            q += 0.2 * FINE * v
    table = np.array(rows).T
    columns = {"t": table[0], "v": table[1], "q_m": np.round(table[2] / 5e-5) * 5e-5}
    return Record(columns, {"t": "s", "v": "V", "q_m": "rad"}, structure="rigid")


def sheet() -> JointFile:
    """Return the datasheet of the joint, within 2 % and its damping within 5 %."""
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": DAMPING, "n": RATIO, "k_t": K_T}
    bare = JointParameters.from_values("arm", known | {"r": R, "v_0": 24.0, "i_p": 20.0})
    units = {"I_m": "kg m^2", "k_t": "N m/A", "r": "Ohm"}
    stated = {s: Quantity(getattr(bare, s), unit, "sheet", 0.02) for s, unit in units.items()}
    stated["d_m"] = Quantity(DAMPING, "N m s/rad", "sheet", 0.05)
    return JointFile(bare.replace(**stated), structure="rigid", drive="static")


@pytest.mark.slow
def test_damping_is_no_torque_constant_inertia_or_dead_time() -> None:
    """It is three times what the tolerances of k_t and r make of the back-EMF."""
    damping = 2.0
    found = diagnose(by_voltage(damping), sheet())
    assert [effect.name for effect in found.effects] == ["damping"]
    value = found.effects[0].parameters["d_m"]
    assert value.value == pytest.approx(damping, rel=0.1)
    assert value.low < damping < value.high


@pytest.mark.slow
def test_the_back_emf_tells_the_torque_constant() -> None:
    """The damping that the datasheet states is small beside that of the back EMF."""
    k_t = 0.85 * K_T
    found = diagnose(by_voltage(DAMPING, k_t), sheet())
    (effect,) = found.effects
    assert (found.verdict, effect.name, effect.status) == (
        "explained",
        "torque_constant",
        "tentative",
    )
    assert effect.parameters["k_t"].low < k_t < effect.parameters["k_t"].high
    assert found.gap.after < 0.05 * found.gap.before


def test_without_a_stated_damping_the_back_emf_does_not_tell_the_torque_constant() -> None:
    stated, made, rigid = sheet(), by_voltage(DAMPING), get_structure("rigid")
    unstated = replace(
        stated, parameters=stated.parameters.replace(d_m=Quantity(DAMPING, "N m s/rad"))
    )
    assert "torque_constant" in examine(made, stated, rigid).can_tell
    assert "torque_constant" not in examine(made, unstated, rigid).can_tell


@pytest.mark.slow
def test_an_exact_joint_has_no_gap() -> None:
    assert diagnose(by_voltage(DAMPING), sheet()).verdict == "no_gap"
