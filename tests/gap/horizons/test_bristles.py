"""Dry friction whose bristles bend before it slides."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.findings.naming import effects_of
from cjt_gym.gap.horizons.prediction.case import make_case
from cjt_gym.gap.horizons.selection.judge import judge
from cjt_gym.gap.stages.select import silent
from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.records import Record

INERTIA, DAMPING, DRY, FALL, SLOW, STIFFNESS, MICRO = 1.0, 3.0, 6.0, 4.0, 0.06, 9000.0, 10.0
"""A mass on bristles of LuGre's law, whose friction falls from rest on: SI units, of a rotation."""


def lugre(seconds: float, seed: int) -> Record:
    """Return a log at 500 Hz of the mass under slow and fast torques, integrated at 20 kHz."""
    rng, step, every = np.random.default_rng(seed), 5e-5, 40
    t = step * np.arange(round(seconds / step))
    torque = sum(
        size * np.sin(2.0 * np.pi * f * t + phase)
        for f, size, phase in zip(
            (0.3, 0.9, 2.3, 6.1), (9.0, 7.0, 8.0, 10.0), rng.uniform(0, 6, 4), strict=True
        )
    )
    held = np.repeat(torque[::every], every)[: len(t)].tolist()
    q = v = z = 0.0
    angle = np.empty(len(t))
    for k, u in enumerate(held):
        angle[k] = q
        level = DRY + FALL * np.exp(-((v / SLOW) ** 2))
        bending = v - STIFFNESS * abs(v) / level * z
        v += step * (u - DAMPING * v - STIFFNESS * z - MICRO * bending) / INERTIA
        z += step * bending
        q += step * v
    angles = angle[::every] + rng.normal(0.0, 2e-6, len(t[::every]))
    columns = {"t": t[::every], "i": torque[::every], "i_cmd": torque[::every], "q_m": angles}
    return Record(columns, {"t": "s", "i": "A", "i_cmd": "A", "q_m": "rad"}, structure="rigid")


@pytest.mark.slow
def test_bristles_and_a_friction_that_falls_are_found_together() -> None:
    """An integration of LuGre's law, which shares no code with the kernel."""
    known = {"I_m": INERTIA, "I_g": 0.0, "I_l": 0.0, "d_m": DAMPING, "n": 1.0, "k_t": 1.0}
    sheet = JointFile(JointParameters.from_values("mass", known))
    judged = judge(make_case([lugre(10.0, 0)], [], sheet, get_structure("rigid")), None, silent)
    named = {e.name: e.parameters for e in effects_of(judged, {}, {})}
    assert set(named) == {"presliding", "stribeck"}
    stiffness = named["presliding"]["sigma_m"]
    assert stiffness.low < STIFFNESS < stiffness.high
