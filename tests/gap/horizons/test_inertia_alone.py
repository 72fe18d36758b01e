"""An inertia that differs from its datasheet beside friction that the torque shows as stated."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import Diagnosis, diagnose
from cjt_gym.joint import JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

DT, INNER = 2e-3, 4
INERTIA, STATED, DAMPING, FRICTION, K_T = 0.020, 0.028, 0.08, 0.05, 1.2


def moved(weight: float, noise: float) -> Record:
    """Return rows of a joint that slow and fast sines drive, with a noisy current."""
    rng = np.random.default_rng(5)
    t = DT * np.arange(6000)
    i = sum(a * np.sin(2.0 * np.pi * f * t + f) for a, f in [(0.4, 0.4), (0.4, 2.3), (0.4, 6.7)])
    q, v, h, angle = 0.0, 0.0, DT / INNER, np.zeros(len(t))
    for k, current in enumerate(i):
        angle[k] = q
        for _ in range(INNER):
            free = v + h / INERTIA * (K_T * current - DAMPING * v - weight * np.sin(q))
            v = free - np.clip(free, -h * FRICTION / INERTIA, h * FRICTION / INERTIA)
            q += h * v
    columns = {
        "t": t,
        "i_cmd": i,
        "i": i + noise * rng.standard_normal(len(t)),
        "q_m": np.round(angle / 4.8e-5) * 4.8e-5,
    }
    units = {"t": "s", "i_cmd": "A", "i": "A", "q_m": "rad"}
    return Record(columns, units, structure="rigid")


def sheet(weight: float) -> JointFile:
    """Return a datasheet with tolerances whose load is too heavy."""
    known = {"I_m": 0.008, "I_l": STATED - 0.008, "I_g": 0.0, "d_m": DAMPING, "n": 1.0, "k_t": K_T}
    units = {"I_m": "kg m^2", "I_l": "kg m^2", "d_m": "N m s/rad", "k_t": "N m/A"}
    spread = {"I_m": 0.05, "I_l": 0.05, "d_m": 0.3, "k_t": 0.03}
    stated = {s: Quantity(known[s], units[s], "sheet", spread[s]) for s in units}
    effects = {"coulomb": {"d_cm": Quantity(FRICTION, "N m", "sheet", 0.2)}}
    if weight:
        effects["gravity"] = {"torque": Quantity(weight, "N m", "sheet", 0.05)}
    bare = JointParameters.from_values("motor", known).replace(**stated)
    return JointFile(bare, effects, structure="rigid", drive="static")


def total(found: Diagnosis) -> float:
    """Return the inertia of all bodies of the joint that was found [kg m^2]."""
    rows = found.joint.effects
    load = rows.get("load_inertia", {}).get("I_l") or found.joint.parameters.quantities["I_l"]
    motor = rows["inertia"]["I_m"]
    assert isinstance(motor, Quantity)
    assert isinstance(load, Quantity)
    return motor.number + load.number


@pytest.mark.slow
@pytest.mark.parametrize("weight", [0.0, 0.15])
def test_it_is_found_and_no_torque_constant(weight: float) -> None:
    found = diagnose(moved(weight, 0.02), sheet(weight))
    names = {e.name: e.status for e in found.effects}
    assert "torque_constant" not in names
    assert total(found) == pytest.approx(INERTIA, rel=0.03)
    if weight:  # beside which no other value of the datasheet makes up for it
        assert names.get("inertia") == "confirmed"
        said = f"an inertia of {total(found):.3g} kg m^2 instead of {STATED:.3g}"
        assert said in found.unexplained.text
