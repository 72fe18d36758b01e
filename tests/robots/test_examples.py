"""The examples with robots run: the arm follows, the leg squats, and energy adds up."""

from __future__ import annotations

import runpy
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cjt_gym.baselines.table import make_controller

pytest.importorskip("mujoco")

EXAMPLES = Path(__file__).parents[2] / "examples"
EXAMPLE = EXAMPLES / "leg.py"


def test_the_arm_follows_and_its_energy_adds_up() -> None:
    found = runpy.run_path(str(EXAMPLES / "arm.py"))["run"](0.8)
    late = found["t"] > 0.3
    assert np.sqrt(np.mean((found["asked"] - found["tau"])[late] ** 2)) < 1.5
    assert np.abs(found["wanted"] - found["q_l"]).max() < 0.1
    assert np.abs(found["given"] - found["taken"]).max() < 5e-3


def test_the_leg_squats_and_its_energy_adds_up() -> None:
    example = runpy.run_path(str(EXAMPLE))
    found = example["run"](1.2)
    late = found["t"] > 0.5
    assert np.abs(found["wanted"] - found["q"])[late].max() < 0.05
    error = np.sqrt(np.mean((found["asked"] - found["tau"])[late] ** 2, axis=0))
    assert (error < 1.5).all()
    assert np.abs(found["given"] - found["taken"]).max() < 2e-3
    down = int(np.argmin(found["energy"]))
    assert found["energy"][down] < -10.0
    assert found["taken"][down] == pytest.approx(found["energy"][down], abs=0.5)


def test_the_environment_of_the_leg_follows_under_impedance_control() -> None:
    env = gym.make(
        "CJT/Leg-v0",
        effects=["coulomb"],
        action_scale=200.0,
        base_controller=lambda joint, dt: make_controller("pid_inner_dob", joint, dt),
    )
    holding = runpy.run_path(str(EXAMPLE))["holding"]
    seen, _ = env.reset(seed=3)
    errors = []
    for _ in range(200):
        one = seen.reshape(2, 6)
        spring, damper = 600.0 * 0.5 * one[:, 1], 25.0 * 5.0 * (one[:, 2] - one[:, 3])
        torque = spring + damper + holding(np.pi * one[:, 0])
        seen, _, terminated, _, info = env.step((torque / 200.0).astype(np.float32))
        assert not terminated
        errors.append(info["q_wanted"] - info["q"])
    assert np.sqrt(np.mean(np.square(errors[60:]))) < 0.1
