"""A torque from row to row: held as a command is, or going on to the next as what was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.errors import ParameterError
from cjt_gym.joint import Joint, load_joint_file
from cjt_gym.joint.files.joint_file import to_toml

FOUND = """
[found.input]
share = {share}
load_share = 0.5
dt = {dt}
"""
DT, SIZE, FAST = 0.02, 3.0, 2.0 * np.pi  # s, N m, rad/s


def joint(folder: Path, found: str = "") -> Joint:
    path = folder / "found.toml"
    path.write_text(to_toml(load_joint_file("orange_80_6000")) + found, encoding="utf-8")
    return load_joint(path, "rigid", effects={"damping": {"d_m": 0.0, "d_g": 0.0, "d_l": 0.0}})


def speed_error(one: Joint, held: bool | None) -> float:
    """Return the largest error of an inertia's speed under a sampled sine [rad/s]."""
    t = np.arange(60) * DT
    record = one.simulate(SIZE * np.sin(FAST * t), dt=DT, held=held)
    assert record["tau_cmd"] == pytest.approx(SIZE * np.sin(FAST * t))
    p = one.parameters
    inertia = p.I_m + p.I_g + p.I_l
    true = SIZE / inertia / FAST * (1.0 - np.cos(FAST * t))
    return float(np.max(np.abs(record["true_dq_m"] - true)) / np.max(true))


def test_the_mean_of_two_rows_follows_a_sampled_torque(tmp_path: Path) -> None:
    one = joint(tmp_path)
    # Held, the speed is late by half a sample; by the trapezoidal rule its error is (w dt)^2 / 12.
    assert speed_error(one, held=True) == pytest.approx(0.5 * FAST * DT / 2.0, rel=0.05)
    assert speed_error(one, held=False) == pytest.approx((FAST * DT) ** 2 / 12.0, rel=0.05)


def test_the_file_says_how_unless_the_call_does(tmp_path: Path) -> None:
    plain = joint(tmp_path)
    held, means = speed_error(plain, held=True), speed_error(plain, held=False)
    assert speed_error(plain, held=None) == held
    measured = joint(tmp_path, FOUND.format(share=0.5, dt=0.02))
    assert speed_error(measured, held=None) == means
    assert speed_error(measured, held=True) == held
    assert speed_error(joint(tmp_path, FOUND.format(share=0.5, dt=0.001)), held=None) == held


def test_a_torque_that_is_logged_late_acts_before_its_row(tmp_path: Path) -> None:
    step = np.repeat([0.0, 1.0], 10)
    late = joint(tmp_path, FOUND.format(share=2.0, dt=0.02)).simulate(step, dt=DT)
    held = joint(tmp_path).simulate(step, dt=DT)
    assert late["true_dq_m"][:18] == pytest.approx(held["true_dq_m"][2:], rel=1e-9)
    assert late["tau_cmd"] == pytest.approx(step)


def test_a_measured_load_is_the_mean_of_two_rows_as_well(tmp_path: Path) -> None:
    load, still = np.repeat([0.0, 1.0], 5), np.zeros(10)
    found = joint(tmp_path, FOUND.format(share=0.0, dt=0.02))
    first = found.simulate(still, load, dt=DT)["true_dq_m"]
    held = found.simulate(still, load, dt=DT, held=True)["true_dq_m"]
    assert held[5] == 0.0
    assert first[5] == pytest.approx(0.5 * held[6], rel=1e-9)


@pytest.mark.parametrize(
    ("entry", "text"),
    [
        ("held = false", "must have share, load_share and dt"),
        ('share = "no"\nload_share = 0.5\ndt = 0.1', "must be 3 finite numbers"),
        ("share = -1.0\nload_share = 0.5\ndt = 0.1", "share and load_share >= 0 and dt > 0, got"),
    ],
)
def test_what_a_file_cannot_mean_is_refused(tmp_path: Path, entry: str, text: str) -> None:
    wrong = joint(tmp_path, f"\n[found.input]\n{entry}\n")
    with pytest.raises(ParameterError, match=rf"\[found.input\] of .*{text}"):
        wrong.simulate(np.zeros(3), dt=DT)
