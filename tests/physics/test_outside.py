"""A simulation outside the ranges at which a joint was found says so, once."""

from __future__ import annotations

import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from cjt_gym import load_joint
from cjt_gym.errors import OutsideFoundWarning, ParameterError
from cjt_gym.joint import Joint, load_joint_file
from cjt_gym.joint.files.joint_file import to_toml

FOUND = """
[found]
speed = { low = -0.5, high = 2.0, unit = "rad/s" }
torque = { low = 1.0, high = 10.0, unit = "N m" }
frequency = { low = 0.0, high = 5.0, unit = "Hz" }
"""


def joint_file(folder: Path, found: str = FOUND) -> Path:
    path = folder / "found.toml"
    path.write_text(to_toml(load_joint_file("orange_80_6000")) + found, encoding="utf-8")
    return path


def joint(folder: Path, found: str = FOUND) -> Joint:
    return load_joint(joint_file(folder, found), "rigid", effects={"damping": {"d_m": 5.0}})


def ramp(size: float, samples: int = 1000) -> np.ndarray:
    return size * np.sin(np.pi * np.arange(samples) / samples)


def test_a_simulation_beyond_what_was_found_warns_once_with_the_figures(tmp_path: Path) -> None:
    found = joint(tmp_path)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found.simulate(ramp(-20.0), dt_physics=1e-4)
        found.simulate(ramp(-30.0), dt_physics=1e-4)
    assert [row.category for row in told] == [OutsideFoundWarning]
    text = str(told[0].message)
    assert "speed of -" in text
    assert "(found at -0.5 to 2 rad/s)" in text
    assert "torque of -20 N m (found at 1 to 10 N m)" in text
    assert "found.toml" in text


def test_rest_and_a_tenth_beyond_are_within(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", OutsideFoundWarning)
        joint(tmp_path).simulate(ramp(10.9), dt_physics=1e-4)
        joint(tmp_path).simulate(ramp(-0.9), dt_physics=1e-4)
    with pytest.warns(OutsideFoundWarning, match=r"torque of 11\.2 N m \(found at 1 to 10 N m\)"):
        joint(tmp_path).simulate(ramp(11.2), dt_physics=1e-4)


def test_a_command_more_than_an_octave_faster_warns(tmp_path: Path) -> None:
    t = np.arange(1000) * 1e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error", OutsideFoundWarning)
        joint(tmp_path).simulate(0.9 * np.sin(2 * np.pi * 9.0 * t), dt_physics=1e-4)
    with pytest.warns(OutsideFoundWarning, match=r"frequency of 20 Hz \(found at 0 to 5 Hz\)"):
        joint(tmp_path).simulate(0.9 * np.sin(2 * np.pi * 20.0 * t), dt_physics=1e-4)


@pytest.mark.parametrize("num", [1, 3])
def test_an_environment_says_so_at_the_end_of_an_episode(tmp_path: Path, num: int) -> None:
    path = joint_file(tmp_path)
    arguments = {"joint": str(path), "structure": "rigid", "episode_steps": 30}
    if num == 1:
        env = gym.make("CJT/TorqueTracking-v0", **arguments)
        env.reset(seed=0)
        for _ in range(30):
            env.step(np.ones(1, dtype=np.float32))
        with pytest.warns(OutsideFoundWarning, match="torque of"):
            env.reset()
    else:
        envs = gym.make_vec("CJT/TorqueTracking-v0", num_envs=num, **arguments)
        envs.reset(seed=0)
        for _ in range(29):
            envs.step(np.ones((num, 1), dtype=np.float32))
        with pytest.warns(OutsideFoundWarning, match="torque of"):
            envs.step(np.ones((num, 1), dtype=np.float32))


def test_a_range_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"\[found.speed\] of .* must have low <= high, got 3"):
        joint(tmp_path, FOUND.replace("low = -0.5", "low = 3")).simulate(ramp(1.0))
    with pytest.raises(ParameterError, match=r"\[found.torque\] .* must have low, high and unit"):
        joint(tmp_path, FOUND.replace("low = 1.0, ", "")).simulate(ramp(1.0))
