"""A simulated plant: its limits, and what it has to do with its joint."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.errors import CjtGymWarning
from cjt_gym.joint import STRUCTURES, joint_names
from cjt_gym.plant import Limits, SimulatedPlant

EFFECTS: dict[str, dict[str, Any]] = {"coulomb": {}, "command_delay": {"delay": 2e-3}}


def plant(num: int = 4, **arguments: Any) -> SimulatedPlant:
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox", effects=EFFECTS)
    return SimulatedPlant(joint, num, **arguments)


def test_a_plant_states_its_step_and_its_limits_and_clips_to_them() -> None:
    p = plant(2)
    peak = 0.078 * 80 * 30
    assert p.dt == 1e-3
    assert p.limits == Limits(tau=peak, dq_m=7.7284, tau_joint=2 * peak)
    p.reset(seed=0)
    for _ in range(4):
        measured = p.step(np.array([1e6, peak]))
    np.testing.assert_array_equal(measured.tau[0], measured.tau[1])
    assert measured.i[0] == pytest.approx(30.0)
    p.close()


def test_a_batch_simulates_what_the_joint_simulates() -> None:
    p = plant(3)
    p.reset(seed=0)
    wanted = 20.0 * np.sin(0.05 * np.arange(200))
    seen = np.array([p.step(np.full(3, u)).tau for u in wanted])
    record = p.joint.simulate(np.append(wanted, 0.0), dt_physics=1e-4)
    np.testing.assert_array_equal(seen[:, 0], record["tau"][1:])
    np.testing.assert_array_equal(seen[:, 0], seen[:, 2])


def test_a_delay_may_be_randomised_up_to_its_longest() -> None:
    spec = {"command_delay.delay": {"low": 0.0, "high": 9e-3, "operation": "set"}}
    p = plant(50, randomization=spec)
    p.reset(seed=0)
    delays = p.batch.arrays.p["command_delay"]
    assert delays.max() > 8e-3
    first = np.full(50, -1)
    for k in range(15):
        moved = p.step(np.full(50, 30.0)).q_m != 0.0
        first[moved & (first < 0)] = k
    np.testing.assert_array_equal(first, np.floor(np.round(delays / 1e-4) / 10.0).astype(int))


@pytest.mark.parametrize(("dt", "told"), [(0.02, False), (0.025, True)])
def test_a_resonance_above_the_nyquist_frequency_is_warned_of(dt: float, told: bool) -> None:
    """Of 22.4 Hz; shipped joints warn of nothing at their usual steps."""
    words = r"22\.4 Hz.* 20 Hz .*dt < 0\.022 s"
    with pytest.warns(CjtGymWarning, match=words) if told else nullcontext():
        SimulatedPlant(load_joint("orange_80_6000", "output_fixed_rigid_gearbox"), 1, dt, 1e-4)
    for name in joint_names():
        for structure in ("rigid",) if name == "emps" else STRUCTURES:
            SimulatedPlant(load_joint(name, structure, effects=[]))
