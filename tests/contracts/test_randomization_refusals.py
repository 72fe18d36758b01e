"""Randomisations that are refused, and in which words."""

from __future__ import annotations

from typing import Any

import pytest

from cjt_gym import load_joint
from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.plant import SimulatedPlant, Variation
from cjt_gym.plant.randomization import resolve_randomization
from tests.contracts.randomized import joint


@pytest.mark.parametrize(
    ("spec", "error", "words"),
    [
        ("mildd", UnknownNameError, "Did you mean 'mild'"),
        (3, ConfigurationError, "name of a preset or a mapping"),
        ({"k_bb": (0.9, 1.1)}, UnknownNameError, "k_b"),
        ({"cogging.scale": (0.9, 1.1)}, UnknownNameError, "active effect"),
        ({"coulomb.d_cx": (0.9, 1.1)}, UnknownNameError, "d_cm"),
        ({"k_b": (1.1, 0.9)}, ConfigurationError, "low <= high"),
        ({"k_b": 3}, ConfigurationError, "factors or a mapping"),
        ({"k_b": {"lo": 1, "high": 2}}, ConfigurationError, "Did you mean 'low'"),
        ({"I_m": (0.0, 1.0)}, ConfigurationError, "> 0"),
        ({"k_b": {"low": 1, "high": 2, "distribution": "gauss"}}, UnknownNameError, "uniform"),
        ({"preset": "mild", "k_bb": (1, 2)}, UnknownNameError, "Did you mean 'k_b'"),
        ({"k_b": {"distribution": "normal", "mean": 1.0}}, ConfigurationError, "got no std"),
        ({"k_b": {"distribution": "choice"}}, ConfigurationError, "got no values"),
        ({"k_b": {"low": 1, "high": 2, "std": 1}}, ConfigurationError, "has no std"),
        (
            {"k_b": {"distribution": "choice", "values": [1, 2], "weights": [1]}},
            ConfigurationError,
            "as many as values",
        ),
        (
            {"k_b": {"distribution": "choice", "values": [1, 2], "weights": [0, 0]}},
            ConfigurationError,
            "not all zero",
        ),
        ({"k_b": {"low": 0.9, "high": 1.1, "when": "interval"}}, ConfigurationError, "> 0 s"),
        ({"k_b": {"low": 0.9, "high": 1.1, "when": "drift"}}, ConfigurationError, "time_constant"),
        ({"k_b": {"low": 0.9, "high": 1.1, "interval": 1.0}}, ConfigurationError, "belongs to"),
        (
            {"k_b": {"low": 0.9, "high": 1.1, "when": "interval", "interval": 1e-4}},
            ConfigurationError,
            "control step of 0.001 s",
        ),
        ({"k_b": {"low": 0.9, "high": 1.1, "when": "often"}}, UnknownNameError, "drift"),
        ({"k_b": {"low": 0.9, "high": 1.1, "correlation": 0.5}}, ConfigurationError, "a group"),
        (
            {"k_b": {"low": 0.9, "high": 1.1, "correlation": 2, "group": "g"}},
            ConfigurationError,
            "from -1 to 1",
        ),
        (
            {
                "k_b": {"low": 0.9, "high": 1.1, "group": "g"},
                "I_m": {"low": 0.9, "high": 1.1, "group": "g", "when": "once"},
            },
            ConfigurationError,
            "k_b and I_m share the group 'g'",
        ),
        ({"k_b": ("a", 2.0)}, ConfigurationError, "randomization of k_b: low must be a finite"),
        ({"k_b": (0.0, 1.0)}, ConfigurationError, "> 0 N m/rad, got a lowest value of 0"),
        (
            {"k_b": {"distribution": "normal", "mean": 1.0, "std": 0.3}},
            ConfigurationError,
            "got a lowest value of -1200",
        ),
        ({"d_m": (-0.1, 1.0)}, ConfigurationError, ">= 0 N m s/rad"),
        ({"command_delay.delay": (-0.5, 1.0)}, ConfigurationError, ">= 0 s"),
        ({"dropout.probability": (0.5, 20.0)}, ConfigurationError, "<= 1, got a highest value of"),
        ({"stribeck.v_s": (0.0, 1.0)}, ConfigurationError, "> 0 rad/s"),
        ({"torque_gain.gain": (-1.0, 1.0)}, ConfigurationError, ">= 0"),
        ({"d_mg": {"low": 1, "high": 2, "distribution": "norm"}}, UnknownNameError, "normal"),
    ],
)
def test_bad_randomisation_is_refused(spec: Any, error: type[Exception], words: str) -> None:
    effects = {
        "coulomb": {},
        "command_delay": {"delay": 1e-3},
        "dropout": {"probability": 0.1},
        "stribeck": {"d_sm": 1.0, "v_s": 0.1},
        "torque_gain": {"gain": 1.1},
    }
    with pytest.raises(error, match=words):
        resolve_randomization(joint(effects=effects), spec)


def test_a_value_that_the_joint_does_not_have_cannot_be_scaled() -> None:
    emps = load_joint("emps", "rigid")
    with pytest.raises(ConfigurationError, match="cannot scale a value that emps does not have"):
        resolve_randomization(emps, {"i_p": (0.5, 1.0)})
    p = SimulatedPlant(emps, 2, randomization={"i_p": Variation(1.0, 2.0, operation="set")})
    p.reset(seed=0)
    assert (p.batch.arrays.p["i_p"] <= 2.0).all()


def test_a_coordinate_keeps_its_inertia() -> None:
    for structure, name in (("full_dynamics", "I_g"), ("rigid_gearbox", "I_l")):
        with pytest.raises(ConfigurationError, match=r"> 0 kg m\^2"):
            resolve_randomization(joint(structure), {name: (0.0, 1.0)})
    assert resolve_randomization(joint("rigid"), {"I_g": (0.0, 1.0)})
