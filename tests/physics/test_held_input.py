"""A torque from row to row: held as a command is, or going on to the next as what was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.errors import ParameterError
from cjt_gym.joint import Joint, load_joint_file
from cjt_gym.joint.files.joint_file import to_toml

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
    measured = joint(tmp_path, "\n[found.input]\nheld = false\n")
    assert speed_error(measured, held=None) == means
    assert speed_error(measured, held=True) == held


def test_what_a_file_cannot_mean_is_refused(tmp_path: Path) -> None:
    wrong = joint(tmp_path, '\n[found.input]\nheld = "no"\n')
    with pytest.raises(ParameterError, match=r"\[found.input\] of .* must have held = true or"):
        wrong.simulate(np.zeros(3), dt=DT)
