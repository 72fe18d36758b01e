"""What a datasheet says of several values that a record shows as one."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.fitting.datasheet import inertias_at
from cjt_gym.joint import Joint, JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity

STATED = {"I_m": 0.2, "I_g": 0.03, "I_l": 0.07}


@pytest.mark.parametrize(
    ("guess", "factor", "off"),
    [
        ("", 1.5, {"I_m": 0.35}),
        ("I_l", 1.5, {"I_l": 0.22}),
        ("", 0.25, {"I_m": 0.005, "I_g": 0.021, "I_l": 0.049}),  # a tenth of a quarter is spared
    ],
)
def test_an_inertia_that_is_off_is_the_rotors_unless_another_is_a_guess(
    guess: str, factor: float, off: dict[str, float]
) -> None:
    values = {**STATED, "n": 1.0, "k_t": 1.0}
    stated = {
        s: Quantity(x, "kg m^2", "test", None if s == guess else 0.05, guess=s == guess)
        for s, x in STATED.items()
    }
    file = JointFile(JointParameters.from_values("mass", values).replace(**stated))
    found = inertias_at(Joint(file, "rigid", "current", {}), factor)
    assert found == pytest.approx(STATED | off)
    assert sum(found.values()) == pytest.approx(factor * sum(STATED.values()))


def test_inertias_change_continuously_with_their_sum() -> None:
    values = {**STATED, "n": 1.0, "k_t": 1.0}
    stated = {s: Quantity(x, "kg m^2", "test", 0.05) for s, x in STATED.items()}
    file = JointFile(JointParameters.from_values("mass", values).replace(**stated))
    joint = Joint(file, "rigid", "current", {})
    factors = np.linspace(0.05, 1.5, 1451)
    found = np.array([list(inertias_at(joint, float(f)).values()) for f in factors])
    assert np.abs(np.diff(found, axis=0)).max() < 1.01 * sum(STATED.values()) * 1e-3
    assert found.min() > 0.0
