"""Bristles, springs and contact against an integrator that shares nothing with the kernel."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cjt_gym.joint import STRUCTURES, load_joint
from cjt_gym.joint.effects import EFFECTS
from tests.physics.cases import Effects, states
from tests.physics.independent import EffectJoint


def breakaway(coulomb: float, excess: float) -> Callable[[float], float]:
    return lambda v: coulomb + excess * math.exp(-((v / 0.1) ** 2))


BRISTLED: Effects = {
    "presliding": {"d_cm": 2.0, "d_cg": 1.0, "d_cl": 0.5, "sigma_m": 4e3, "sigma_g": 2e3}
    | {"sigma_l": 1e3, "sigma_1": 3.0},
    "stribeck": {"d_cm": 0.0, "d_cg": 0.0, "d_cl": 0.0, "d_sm": 1.0, "d_sg": 0.5, "d_sl": 0.2}
    | {"v_s": 0.1},
}
BRISTLES = {
    "level": (breakaway(2.0, 1.0), breakaway(1.0, 0.5), breakaway(0.5, 0.2)),
    "sigma": (4e3, 2e3, 1e3),
    "sigma_1": 3.0,
}
STOP = {"stiffness": 2e4, "exponent": 1.5, "damping": 0.7, "position": 0.02}
LOOP = {"tau_h": 3.0, "delta_h": 1e-3}
CASES: dict[str, tuple[Effects, dict[str, Any]]] = {
    "bristles": (BRISTLED, BRISTLES),
    "backlash": ({"backlash": {"gap": 1e-3}}, {"gap": 1e-3}),
    "hardening": ({"hardening": {"k_3": 1e8}}, {"k_3": 1e8}),
    "hysteresis": ({"spring_hysteresis": LOOP}, LOOP),
    "contact": (
        {"contact": STOP, "gravity": {"torque": 15.0}},
        {"weight": 15.0, "contact": tuple(STOP.values())},
    ),
}
"""Effects, and what they are to the integrator."""


@pytest.mark.parametrize(
    ("name", "structure"),
    [
        (name, structure)
        for name, (effects, _) in CASES.items()
        for structure, row in STRUCTURES.items()
        if all(EFFECTS[effect].acts_in(row, "current") for effect in effects)
    ],
)
def test_effects_against_an_integrator(name: str, structure: str) -> None:
    """Loading, slipping, bouncing, reversal and return; second order in the step."""
    effects, same = CASES[name]
    damped = {"I_l": 0.5, "d_gl": 2.0}
    joint = load_joint("orange_80_6000", structure, effects=effects, parameters=damped)
    values = {s: q.value for s, q in joint.parameters.quantities.items()}
    tau_m = np.repeat([2.0, 20.0, -15.0, 4.0], 50)
    load = np.full(len(tau_m), 0.02 if joint.structure_row.output_fixed else 1.0)
    exact = EffectJoint(values, structure, **same).states(tau_m, load, 1e-3, np.zeros(6))[:, :6]
    peak = np.abs(exact).max(axis=0) + 1e-9
    coarse, fine = (
        (np.abs(states(joint.simulate(tau_m, load, dt_physics=h)) - exact) / peak).max()
        for h in (1e-4, 1e-5)
    )
    assert name != "contact" or (exact[:, 2] > STOP["position"]).any()
    assert fine < 1e-4
    assert fine < 0.03 * coarse
