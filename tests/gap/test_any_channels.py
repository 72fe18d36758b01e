"""A joint that does what its datasheet says, logged with few channels, or slowly."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from cjt_gym.gap import diagnose
from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.horizons.prediction.model import MEASURES, quiet
from cjt_gym.joint import load_joint
from cjt_gym.records import Record, default_units

SHAPES = ("rigid", "rigid_gearbox", "full_dynamics", "output_fixed_rigid_gearbox", "output_fixed")
CHANNELS = (
    ("i_cmd", "q_m"),
    ("i", "q_m"),
    ("i_cmd", "i", "q_m", "tau"),
    ("i_cmd", "q_m", "q_l", "tau"),
    ("i_cmd", "q_m", "dq_m", "q_l"),
    ("i_cmd", "tau"),
)
RATES = (1e-3, 5e-3, 0.02)
EVERY = [
    (shape, channels, dt)
    for shape, channels, dt in product(SHAPES, CHANNELS, RATES)
    if ("q_m" in channels or "fixed" in shape) and (dt < 0.02 or shape == "rigid")
]


def found(shape: str, channels: tuple[str, ...], dt: float) -> Diagnosis:
    """Return the diagnosis of steps of the torque that last several rows."""
    joint = quiet(load_joint("orange_80_6000", shape, parameters={"I_l": 0.3, "d_gl": 0.5}))
    rows = round(max(6.0, 400 * dt) / dt)
    torque = np.repeat(np.random.default_rng(1).uniform(-20.0, 20.0, rows), 4)[:rows]
    made = joint.simulate(torque, dt=dt)
    amps = torque / (joint.parameters.k_t * joint.parameters.n)
    known = {"t": dt * np.arange(rows), "i_cmd": amps, "i": np.append(0.0, amps[:-1])}
    known |= {name: made[f"true_{name}"] for name in ("q_m", "dq_m", "q_l", "tau")}
    names = ("t", *channels)
    record = Record({n: known[n] for n in names}, default_units(names), structure=shape)
    return diagnose(record, joint.file, shape)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "channels", "dt"), EVERY)
def test_no_cause_is_confirmed_whatever_is_logged(
    shape: str, channels: tuple[str, ...], dt: float
) -> None:
    answer = found(shape, channels, dt)
    steps_seen = "i_cmd" in channels or shape == "rigid"  # a spring feels when a current steps
    assert answer.verdict in ("no_gap", "explained") or not steps_seen, answer.unexplained.text
    named = {e.name for e in answer.effects if e.status == "confirmed"}
    assert named <= set(MEASURES)
    errors = [(row.datasheet, row.found) for row in answer.horizons]
    assert np.isfinite(errors).all()
