"""A motor on a voltage, whose back EMF brakes it as damping does."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.horizons.fitting.fit import Fit
from cjt_gym.gap.horizons.fitting.terms import candidates, scales_of
from cjt_gym.gap.horizons.fitting.uncertainty import _of_scale
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.selection.stepwise import added
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.records import Record

DT, INNER = 1e-3, 10
INERTIA, K_T, R, DRY, DAMPING = 1e-5, 0.05, 3.7, 0.01, 1.5e-4


def motor() -> Record:
    """Return a chirp of the voltage with dry friction and a little damping."""
    t = DT * np.arange(12_000)
    volts = 9.0 * np.sin(2.0 * np.pi * (0.2 + 0.3 * t) * t)
    q, v, h, rows = 0.0, 0.0, DT / INNER, np.zeros((len(t), 2))
    for k, u in enumerate(volts):
        rows[k] = q, v
        for _ in range(INNER):
            free = v + h / INERTIA * (K_T * (u - K_T * v) / R - DAMPING * v)
            v = free - min(max(free, -h * DRY / INERTIA), h * DRY / INERTIA)
            q += h * v
    rng = np.random.default_rng(1)
    speed = rows[:, 1] + 0.3 * rng.standard_normal(len(t))
    columns = {"t": t, "v": volts, "dq_m": speed, "q_m": np.round(rows[:, 0] / 1e-3) * 1e-3}
    units = {"t": "s", "v": "V", "dq_m": "rad/s", "q_m": "rad"}
    return Record(columns, units, structure="rigid")


def sheet(tolerance: float) -> JointFile:
    """Return a datasheet that knows no friction, and k_t and r within a tolerance."""
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": 0.0, "n": 1.0, "k_t": K_T, "r": R}
    bare = JointParameters.from_values("motor", known | {"v_0": 12.0, "i_p": 5.0})
    stated = {
        "I_m": Quantity(INERTIA, "kg m^2", "guess"),
        "d_m": Quantity(0.0, "N m s/rad", "not stated"),
        "k_t": Quantity(K_T, "N m/A", "sheet", tolerance),
        "r": Quantity(R, "Ohm", "sheet", tolerance),
    }
    return JointFile(bare.replace(**stated), structure="rigid", drive="static")


def test_friction_is_no_surer_than_the_resistance() -> None:
    """Where nothing else states a torque, all of them follow from r: its tolerance is theirs."""
    for tolerance in (0.05, 0.2):
        case = make_case([motor()], [], sheet(tolerance), get_structure("rigid"))
        scales = scales_of(case.joint, case.logs)
        dry = next(t for t in candidates(case.joint, scales, case.logs) if t.name == "coulomb")
        fit = Fit(*added(Fit(Model(case.joint, ()), np.zeros(0), 0.0, []), dry, (DRY,)), 0.0, [])
        (deviation,) = np.sqrt(np.diag(_of_scale(fit, voltage=True))) * dry.numbers[0].scale
        assert deviation == pytest.approx(tolerance * DRY)


@pytest.mark.slow
def test_damping_is_told_only_beyond_the_tolerance_of_the_back_emf() -> None:
    """Tolerances of 5 % allow 8e-5 N m s/rad more or less, those of 0.2 % a 25th of that."""
    made = motor()
    for tolerance, status in ((0.05, "tentative"), (0.002, "confirmed")):
        named = {e.name: e for e in diagnose(made, sheet(tolerance)).effects}
        assert named["coulomb"].status == "confirmed"
        told = named.get("damping")
        assert (told.status if told is not None else "tentative") == status
    assert told is not None
    value = told.parameters["d_m"]
    assert value.value == pytest.approx(DAMPING, rel=0.05)
    assert value.low < DAMPING < value.high
    exact = named["coulomb"].parameters["d_cm"]
    vague = {e.name: e for e in diagnose(made, sheet(0.05)).effects}["coulomb"].parameters["d_cm"]
    assert exact.high - exact.low < 0.1 * DRY
    assert vague.high - vague.low > 2.0 * 1.9 * 0.05 * DRY
    assert vague.low < DRY < vague.high
