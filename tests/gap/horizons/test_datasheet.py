"""What a datasheet says of several values that a record shows as one."""

from __future__ import annotations

import numpy as np
import pytest

from cjt_gym.gap.horizons.fitting.base_terms import base_terms
from cjt_gym.gap.horizons.fitting.datasheet import inertias_at, stated_tolerance
from cjt_gym.gap.horizons.prediction.model import Scales
from cjt_gym.joint import Joint, JointFile
from cjt_gym.joint.files.parameters import JointParameters
from cjt_gym.joint.files.quantity import Quantity

SCALES = Scales(torque=1.0, speed=1.0, peak=40.0, travel=3.0)
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


@pytest.mark.parametrize(
    ("tolerances", "expected"),
    [
        ((0.2, 0.1), 0.0916),  # nearly all of it is the gear's
        ((0.02, 0.2), 0.1778),
        ((0.1, None), None),  # what is stated without a tolerance is not known
    ],
)
def test_damping_of_bodies_that_move_as_one_is_known_as_well_as_its_parts(
    tolerances: tuple[float, float | None], expected: float | None
) -> None:
    values = {"I_m": 0.2, "n": 1.0, "k_t": 1.0, "d_m": 2.0, "d_g": 16.0}
    stated = {
        s: Quantity(values[s], "N m s/rad", "test", t)
        for s, t in zip(("d_m", "d_g"), tolerances, strict=True)
    }
    file = JointFile(JointParameters.from_values("masses", values).replace(**stated))
    joint = Joint(file, "rigid", "current", {})
    term = next(t for t in base_terms(joint, SCALES) if t.name == "damping")
    known = stated_tolerance(joint, term)
    assert known == (None if expected is None else pytest.approx(expected, abs=1e-4))
