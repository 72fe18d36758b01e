"""Gains are known to be for the joint that they were tuned for, by its name or by its file."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from cjt_gym.baselines.gains import Choice
from cjt_gym.errors import CjtGymWarning
from cjt_gym.joint import load_joint
from cjt_gym.params import __file__ as params

STRUCTURE = "output_fixed_rigid_gearbox"


def test_a_joint_whose_name_is_not_that_of_its_file_is_recognised(tmp_path: Path) -> None:
    text = (Path(params).parent / "orange_80_6000.toml").read_text("utf-8")
    file = tmp_path / "sea.toml"
    file.write_text(text.replace('name = "orange_80_6000"', 'name = "elbow of our arm"'))
    joint = load_joint(str(file), STRUCTURE)
    gains = {"kp": 0.4, "kd": 0.005, "lead": 0.9}
    for told in (str(file), "sea.toml", "elbow of our arm"):
        choice = Choice("mine", "pd_feedforward", gains, {"joint": told, "structure": STRUCTURE})
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            choice.make(joint, 1e-3)
    other = Choice("mine", "pd_feedforward", gains, {"joint": "lemon", "structure": STRUCTURE})
    with pytest.warns(CjtGymWarning, match="were tuned for lemon"):
        other.make(joint, 1e-3)
