"""Presets of randomised joints, and draws from an identified joint."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from cjt_gym import load_joint
from cjt_gym.errors import ConfigurationError, ParameterError
from cjt_gym.joint import STRUCTURES, Joint, joint_names, load_joint_file
from cjt_gym.joint.files.joint_file import to_toml
from cjt_gym.joint.files.quantity import Quantity
from cjt_gym.plant import SimulatedPlant, Variation
from cjt_gym.plant.randomization import resolve_randomization
from cjt_gym.plant.randomization.target import find_target
from tests.contracts.randomized import NAME, NUM, STRUCTURE, drawn, joint

RIGID_ONLY = ("emps", "emps_frictionless")
GRID = [
    (name, structure)
    for name in joint_names()
    for structure in STRUCTURES
    if name not in RIGID_ONLY or structure == "rigid"
]

# -------------------------------------------------------------------------------- presets


@pytest.mark.parametrize("preset", ["mild", "wide"])
@pytest.mark.parametrize(("name", "structure"), GRID)
def test_presets_are_valid_for_every_joint_and_effect(
    preset: str, name: str, structure: str
) -> None:
    known = {"I_l": 1.0} if name in RIGID_ONLY else {}  # without a load there is no load_inertia
    base = load_joint(name, structure, effects="all", parameters=known)
    spec = resolve_randomization(base, preset)
    varied = {key.split(".")[0] for key in spec if "." in key}
    # An effect of which the joint has nothing to vary (its size is that of no effect) may miss.
    assert len(set(base.effects) - varied) <= 2, set(base.effects) - varied
    p = SimulatedPlant(base, 3, randomization=preset)
    p.reset(seed=0)
    for key, values in p.drawn().items():
        low, high = find_target(base, key).span(spec[key], name)
        assert (values >= low - 1e-12 * abs(low)).all(), key
        assert (values <= high + 1e-12 * abs(high)).all(), key
    assert np.isfinite(p.measurement().tau).all()


@pytest.mark.parametrize("preset", ["mild", "wide"])
@pytest.mark.parametrize("drive", ["static", "rl", "dq"])
def test_presets_are_valid_for_every_drive(preset: str, drive: str) -> None:
    base = load_joint(NAME, "full_dynamics", drive, effects="all")
    spec = resolve_randomization(base, preset)
    assert "r" in spec
    assert ("l_a" in spec) == (drive != "static")
    p = SimulatedPlant(base, 3, randomization=preset)
    p.reset(seed=0)
    assert np.isfinite(p.step(np.full(3, 1.0)).tau).all()


def test_a_preset_can_be_changed() -> None:
    spec = resolve_randomization(
        joint(), {"preset": "mild", "k_b": (0.5, 2.0), "I_m": None, "command_delay.delay": None}
    )
    plain = resolve_randomization(joint(), "mild")
    assert spec["k_b"] == Variation(0.5, 2.0)
    assert set(plain) - set(spec) == {"I_m", "command_delay.delay"}
    assert plain["command_delay.delay"] == Variation(0.0, 1e-3, operation="add")


def with_tolerances(path: Path) -> Path:
    """Write the file that an identification would: values with their uncertainty."""
    file = load_joint_file(NAME)
    quantities = dict(file.parameters.quantities)
    for name, tolerance in (("k_b", 0.02), ("d_cm", 0.1), ("d_m", 0.9)):
        quantities[name] = dataclasses.replace(quantities[name], tolerance=tolerance)
    effects = {
        "cogging": {
            "f": Quantity((480.0,), "1/rev"),
            "a": Quantity((0.3,), "N m", tolerance=0.05),
            "b": Quantity((0.1,), "N m", tolerance=0.2),
        },
        "torque_bias": {"bias": Quantity(-0.2, "N m", tolerance=0.5)},
        "coulomb": {"d_cg": Quantity(3.0, "N m")},
    }
    parameters = dataclasses.replace(file.parameters, quantities=quantities)
    path.write_text(to_toml(dataclasses.replace(file, parameters=parameters, effects=effects)))
    return path


def test_identified_varies_what_has_a_tolerance(tmp_path: Path) -> None:
    base = load_joint(with_tolerances(tmp_path / "found.toml"), STRUCTURE)
    spec = resolve_randomization(base, "identified")
    sigmas = {"k_b": 0.02, "d_m": 0.9, "coulomb.d_cm": 0.1}
    sigmas |= {"cogging.scale": 0.2, "torque_bias.bias": 0.5}
    assert {name: v.std for name, v in spec.items()} == sigmas
    p = SimulatedPlant(base, NUM, randomization="identified")
    p.reset(seed=1)
    v = p.drawn()
    exact = stats.truncnorm(-4, 4, 6000.0, 120.0)
    assert stats.kstest(v["k_b"], exact.cdf).pvalue > 1e-3
    assert v["d_m"].min() > 0.0
    assert v["torque_bias.bias"].max() > 0.0
    other = load_joint(tmp_path / "found.toml", STRUCTURE, effects={"coulomb": {"d_cm": 1.0}})
    assert "coulomb.d_cm" not in resolve_randomization(other, "identified")
    mild = resolve_randomization(base, "mild")
    assert (mild["k_b"].distribution, mild["I_m"].distribution) == ("normal", "uniform")


def test_identified_without_tolerances_says_what_to_do() -> None:
    with pytest.raises(ConfigurationError, match=r"needs intervals or tolerances.*tolerance = "):
        resolve_randomization(joint(), "identified")
    emps = load_joint("emps", "rigid")
    assert set(resolve_randomization(emps, "identified")) == {"I_m"}


FOUND = """
[effects.coulomb]
d_cm = { value = 2.0, unit = "N m", low = 1.0, high = 3.0 }

[effects.torque_bias]
bias = { value = 0.5, unit = "N m", low = 0.1, high = 0.9 }

[found.covariance]
names = ["coulomb.d_cm", "damping.d_m", "torque_constant.k_t", "inertia.I_m"]
values = [2.0, 3.0, 0.041, 0.5]
matrix = [[0.04, 0.054, 0.0, 0.0], [0.054, 0.09, 0.0, -0.0045],
          [0.0, 0.0, 4e-6, 0.0], [0.0, -0.0045, 0.0, 2.5e-3]]
"""


def found_joint(path: Path, text: str = FOUND, **arguments: Any) -> Joint:
    """Return a joint with a stated covariance; its damping is the effect's own, 3 N m s/rad."""
    file = to_toml(load_joint_file(NAME)).partition("\n[effects")[0]
    more = '[effects.damping]\nd_m = { value = 3.0, unit = "N m s/rad" }\n'
    more += '[effects.inertia]\nI_m = { value = 0.5, unit = "kg m^2" }\n'
    path.write_text(f"{file}\n{more}{text}")
    return load_joint(path, STRUCTURE, **arguments)


def test_identified_draws_together_what_has_a_covariance(tmp_path: Path) -> None:
    p = SimulatedPlant(found_joint(tmp_path / "j.toml"), 20000, randomization="identified")
    p.reset(seed=1)
    v = p.drawn()
    names = ["coulomb.d_cm", "damping.d_m", "inertia.I_m"]
    table = np.array([v[name] for name in names])
    stated = np.array([[0.04, 0.054, 0.0], [0.054, 0.09, -0.0045], [0.0, -0.0045, 2.5e-3]])
    size = np.sqrt(np.diag(stated))
    np.testing.assert_allclose(table.mean(axis=1), [2.0, 3.0, 0.5], atol=0.02)
    np.testing.assert_allclose(table.std(axis=1), size, rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(table), stated / np.outer(size, size), atol=0.03)
    assert abs(np.corrcoef(v["torque_bias.bias"], v["coulomb.d_cm"])[0, 1]) < 0.03
    assert 0.1 <= v["torque_bias.bias"].min() < v["torque_bias.bias"].max() <= 0.9
    assert "torque_constant.k_t" not in v  # no effect of this joint


def test_a_value_that_is_no_longer_the_found_one_is_not_drawn(tmp_path: Path) -> None:
    other = found_joint(tmp_path / "j.toml", effects={"coulomb": {"d_cm": 1.0}, "damping": {}})
    spec = resolve_randomization(other, "identified")
    assert set(spec) == {"damping.d_m"}
    again = Variation(**spec["damping.d_m"].to_dict())
    assert again == spec["damping.d_m"]


def test_joint_draws_stay_where_a_number_may_be(tmp_path: Path) -> None:
    wide = FOUND.replace("[0.04, 0.054", "[4.0, 0.54").replace("[0.054, ", "[0.54, ")
    p = SimulatedPlant(found_joint(tmp_path / "j.toml", wide), NUM, randomization="identified")
    p.reset(seed=1)
    v = p.drawn()
    assert 0.0 <= v["coulomb.d_cm"].min() < 0.1
    assert np.corrcoef(v["coulomb.d_cm"], v["damping.d_m"])[0, 1] > 0.8


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.09, 0.0, -0.0045]", "0.09, 0.0]", "matrix of .* must be 4 x 4 finite numbers"),
        ("[0.054, 0.09", "[0.01, 0.09", "symmetric and without negative variances"),
        ("0.054", "0.07", "symmetric and without negative variances"),
        ("values = [2.0", "value = [2.0", "must have names, values and matrix"),
    ],
)
def test_a_table_that_is_no_covariance_is_refused(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    broken = found_joint(tmp_path / "j.toml", FOUND.replace(old, new))
    with pytest.raises(ParameterError, match=words):
        resolve_randomization(broken, "identified")


def test_a_mixture_of_groups_has_the_stated_correlations() -> None:
    spec = {"distribution": "normal", "mean": 1.0, "std": 0.01}
    mixed = spec | {"group": ["a", "b"], "correlation": [0.6, -0.7]}
    v = drawn({"k_b": spec | {"group": "a"}, "d_m": spec | {"group": "b"}, "I_m": mixed})
    found = np.corrcoef([v["k_b"], v["d_m"], v["I_m"]])[2, :2]
    np.testing.assert_allclose(found, [0.6, -0.7], atol=0.05)
