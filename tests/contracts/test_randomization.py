"""Every distribution, operation, time, group and preset of randomised joints."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import tomllib
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import special, stats

from cjt_gym import load_joint
from cjt_gym.errors import CjtGymError, ConfigurationError, ParameterError, UnknownNameError
from cjt_gym.joint import STRUCTURES, Joint, joint_names, load_joint_file
from cjt_gym.joint.arrays import K_M
from cjt_gym.joint.batch import CHANNEL_DELAYS
from cjt_gym.joint.configure import FIELDS
from cjt_gym.joint.files import to_toml
from cjt_gym.joint.quantity import Quantity
from cjt_gym.plant import SimulatedPlant, Variation
from cjt_gym.plant.randomization import PRESETS, resolve_randomization, variable_names
from cjt_gym.plant.randomization.draw import normal_quantile
from cjt_gym.plant.randomization.program import compile_plan
from cjt_gym.plant.randomization.target import find_target
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.run_folder import begin_run

NAME, STRUCTURE = "orange_80_6000", "output_fixed_rigid_gearbox"
EFFECTS: dict[str, Any] = {"coulomb": {}, "command_delay": {"delay": 2e-3}, "noise": {}}
NUM = 2000
RIGID_ONLY = ("emps", "emps_frictionless")
GRID = [
    (name, structure)
    for name in joint_names()
    for structure in STRUCTURES
    if name not in RIGID_ONLY or structure == "rigid"
]
Floats = NDArray[np.float64]


def joint(structure: str = STRUCTURE, effects: Any = None, **parameters: float) -> Joint:
    return load_joint(NAME, structure, effects=effects or EFFECTS, parameters=parameters)


def plant(spec: Any, num: int = 4, **arguments: Any) -> SimulatedPlant:
    return SimulatedPlant(joint(), num, randomization=spec, **arguments)


def drawn(spec: Any, num: int = NUM) -> dict[str, Floats]:
    p = plant(spec, num)
    p.reset(seed=5)
    return p.drawn()


def run(p: SimulatedPlant, steps: int) -> None:
    for _ in range(steps):
        p.advance(np.zeros(p.num), np.zeros(p.num))


# --------------------------------------------------------------------------- distributions


@pytest.mark.parametrize(
    ("spec", "exact"),
    [
        ((0.5, 2.0), stats.uniform(0.5, 1.5)),
        ({"low": 0.5, "high": 2.0, "distribution": "log_uniform"}, stats.loguniform(0.5, 2.0)),
        ({"distribution": "normal", "mean": 1.0, "std": 0.1}, stats.truncnorm(-4, 4, 1.0, 0.1)),
        (
            {"distribution": "normal", "mean": 1.0, "std": 0.5, "low": 0.8, "high": 2.0},
            stats.truncnorm(-0.4, 2.0, 1.0, 0.5),
        ),
    ],
)
@pytest.mark.parametrize("when", [{}, {"when": "drift", "time_constant": 1.0}])
@pytest.mark.parametrize("group", [{}, {"group": "g"}, {"group": "g", "correlation": -0.5}])
def test_draws_have_the_declared_distribution(
    spec: Any, exact: Any, when: dict[str, Any], group: dict[str, Any]
) -> None:
    """Kolmogorov and Smirnov; with 2000 draws, p > 1e-3 holds for 1 - 1e-3 of all seeds."""
    full = dict(zip(("low", "high"), spec, strict=True)) if isinstance(spec, tuple) else spec
    values = drawn({"k_b": full | when | group})["k_b"] / 6000.0
    assert stats.kstest(values, exact.cdf).pvalue > 1e-3


def test_choices_have_the_declared_shares() -> None:
    spec = {"distribution": "choice", "values": [0.5, 1.0, 2.0], "weights": [1, 0, 3]}
    values, counts = np.unique(drawn({"k_b": spec})["k_b"], return_counts=True)
    np.testing.assert_array_equal(values, [3000.0, 12000.0])
    assert stats.binomtest(counts[0], NUM, 0.25).pvalue > 1e-3


def test_the_normal_quantile_is_exact() -> None:
    u = np.concatenate([10.0 ** np.arange(-250, -1, 7.0), np.linspace(0.01, 0.99, 99)])
    mine = [normal_quantile(x) for x in u]
    np.testing.assert_allclose(mine, special.ndtri(u), rtol=1e-13, atol=1e-15)
    for x in (0.0, 1.0):
        assert np.isfinite(normal_quantile(x))


@pytest.mark.parametrize(
    ("operation", "low", "high"),
    [("scale", 3000.0, 9000.0), ("add", 6000.5, 6001.5), ("set", 0.5, 1.5)],
)
def test_operations(operation: str, low: float, high: float) -> None:
    values = drawn({"k_b": {"low": 0.5, "high": 1.5, "operation": operation}})["k_b"]
    assert low <= values.min() < low + 0.01 * (high - low)
    assert high - 0.01 * (high - low) < values.max() <= high


# ------------------------------------------------------------------------ names and effects


def test_every_name_can_vary_and_is_what_a_joint_with_that_value_has() -> None:
    """The record of a draw is that of a joint that was loaded with the drawn values."""
    base = load_joint(NAME, "full_dynamics", effects="all", parameters={"I_l": 0.5})
    names = [n for n in variable_names(base) if "." in n]
    assert len(names) > 70
    for name in names:
        target = find_target(base, name)
        spec = {"low": 0.9 * target.nominal, "high": 1.1 * target.nominal + 1e-3}
        p = SimulatedPlant(base, 1, randomization={name: spec | {"operation": "set"}})
        p.reset(seed=3)
        effect, symbol = name.split(".")
        values = {key: dict(v) for key, v in base.effects.items()}
        value = p.drawn()[name][0]
        assert value != target.nominal, name
        for other in values if symbol == "dq_0" else [effect]:
            if symbol in values[other]:
                values[other][symbol] = value
        changed = dataclasses.replace(base, effects=values)
        np.testing.assert_allclose(
            p.batch.arrays.p.view(np.float64), changed.packed()[0].view(np.float64), rtol=1e-12
        )


@pytest.mark.parametrize("name", ["I_m", "I_g", "k_b", "k_g", "d_m", "d_gl", "n", "k_t", "i_p"])
def test_base_parameters_vary_and_are_discretised(name: str) -> None:
    base = joint("full_dynamics", effects={"noise": {}}, d_gl=1.0)
    p = SimulatedPlant(base, 1, randomization={name: (0.8, 1.2)})
    p.reset(seed=3)
    value = p.drawn()[name][0]
    same = SimulatedPlant(joint("full_dynamics", {"noise": {}}, **{"d_gl": 1.0, name: value}))
    for one, other in zip(p.batch.arrays[2:4], same.batch.arrays[2:4], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    np.testing.assert_allclose(
        p.batch.arrays.p.view(np.float64), same.batch.arrays.p.view(np.float64), rtol=1e-12
    )


def test_several_names_of_one_kernel_parameter_compose() -> None:
    effects = {"inertia": {"I_m": 0.3}, "coulomb": {"d_cm": 2.0}, "stribeck": {"d_cm": 1.0}}
    base = joint(effects=effects | {"stribeck": {"d_cm": 1.0, "d_sm": 0.5, "v_s": 0.1}})
    spec = {"inertia.I_m": (0.9, 1.1), "I_m": (0.9, 1.1)}
    spec |= {"coulomb.d_cm": (0.5, 1.5), "stribeck.d_cm": (0.5, 1.5)}
    p = SimulatedPlant(base, 50, randomization=spec)
    p.reset(seed=0)
    q, d = p.batch.arrays.p, p.drawn()
    np.testing.assert_allclose(q["I_m"], d["inertia.I_m"] + d["I_m"] - 0.23, rtol=1e-12)
    np.testing.assert_allclose(q["d_cm"], d["coulomb.d_cm"] + d["stribeck.d_cm"], rtol=1e-12)
    with pytest.raises(ConfigurationError, match=r"inertia\.I_m and I_m .* together|lowest value"):
        SimulatedPlant(base, 1, randomization={"inertia.I_m": (0.1, 1.0), "I_m": (0.1, 1.0)})


def test_damping_at_negative_velocity_stays_what_it_is_called() -> None:
    base = joint(effects={"viscous_asym": {"d_m_n": 0.2}}, d_m=1.0, d_m_n=1.0)
    p = SimulatedPlant(base, 50, randomization={"d_m": (0.1, 2.0)})
    p.reset(seed=0)
    q = p.batch.arrays.p
    np.testing.assert_allclose(q["d_m"] + q["d_m_extra_n"], 0.2, rtol=1e-12)


# --------------------------------------------------------------------------------- groups


def test_a_group_shares_one_draw() -> None:
    group = {"group": "g"}
    spec = {
        "k_b": {"low": 0.5, "high": 1.5} | group,
        "I_m": {"distribution": "normal", "mean": 1.0, "std": 0.1} | group,
        "coulomb.d_cm": {"low": 0.5, "high": 1.5, "correlation": -1.0} | group,
        "d_m": (0.5, 1.5),
    }
    v = drawn(spec)
    rank = {name: stats.rankdata(x) for name, x in v.items()}
    np.testing.assert_array_equal(rank["k_b"], rank["I_m"])
    np.testing.assert_array_equal(rank["k_b"], NUM + 1 - rank["coulomb.d_cm"])
    assert abs(np.corrcoef(rank["k_b"], rank["d_m"])[0, 1]) < 0.08


@pytest.mark.parametrize("correlation", [-0.8, 0.0, 0.6])
def test_a_partial_correlation_is_that_of_normal_scores(correlation: float) -> None:
    normal = {"distribution": "normal", "mean": 1.0, "std": 0.1, "group": "g"}
    v = drawn({"k_b": normal, "I_m": normal | {"correlation": correlation}})
    found = np.corrcoef(v["k_b"], v["I_m"])[0, 1]
    assert abs(np.arctanh(found) - np.arctanh(correlation)) < 4.0 / np.sqrt(NUM)


# ----------------------------------------------------------------------------------- times


def test_once_holds_until_another_seed() -> None:
    p = plant({"k_b": Variation(0.5, 1.5, when="once"), "I_m": (0.5, 1.5)})
    p.reset(seed=1)
    first = p.drawn()
    p.reset()
    again = p.drawn()
    np.testing.assert_array_equal(first["k_b"], again["k_b"])
    assert (first["I_m"] != again["I_m"]).all()
    p.fix({"I_m": 0.2})
    p.reset()
    p.fix(None)
    p.reset()
    np.testing.assert_array_equal(first["k_b"], p.drawn()["k_b"])
    p.reset(seed=2)
    assert (first["k_b"] != p.drawn()["k_b"]).all()
    p.reset(seed=1)
    np.testing.assert_array_equal(first["k_b"], p.drawn()["k_b"])


def test_an_interval_redraws_within_the_episode_and_leaves_the_state_alone() -> None:
    p = plant({"k_b": {"low": 0.5, "high": 1.5, "when": "interval", "interval": 5e-3}})
    p.reset(seed=1)
    values, changed = [p.drawn()["k_b"]], []
    for _ in range(16):
        before = p.batch.arrays.state.copy()
        p.advance(np.full(4, 20.0), np.zeros(4))
        assert np.abs(p.batch.arrays.state - before)[:, :3].max() < 1e-3
        values.append(p.drawn()["k_b"])
        changed.append(p.changed.copy())
    due = np.arange(16) % 5 == 0
    due[0] = False
    np.testing.assert_array_equal(np.array(changed), np.repeat(due[:, None], 4, axis=1))
    np.testing.assert_array_equal((np.diff(values, axis=0) != 0.0).all(axis=1), due)
    assert (p.batch.arrays.samples == 16).all()


def test_a_redraw_leaves_state_and_memory_alone() -> None:
    p = plant("wide")
    p.reset(seed=1)
    run(p, 5)
    arrays = p.batch.arrays
    kept = ("state", "currents", "tau", "commands", "outputs", "measured", "samples")
    before, values = {name: getattr(arrays, name).copy() for name in kept}, p.drawn()
    p.redraw(np.array([True, False, True, True]))
    for name, old in before.items():
        np.testing.assert_array_equal(getattr(arrays, name), old, err_msg=name)
    for name, drawn_now in p.drawn().items():
        np.testing.assert_array_equal(drawn_now != values[name], [True, False, True, True])


def test_a_redrawn_stiffness_is_discretised_within_the_episode() -> None:
    p = plant({"k_b": {"low": 0.5, "high": 1.5, "when": "interval", "interval": 1e-2}}, 1)
    p.reset(seed=1)
    run(p, 11)
    same = SimulatedPlant(joint(k_b=float(p.drawn()["k_b"][0])), 1)
    np.testing.assert_allclose(p.batch.arrays.a, same.batch.arrays.a, rtol=1e-12)


def test_a_redrawn_torque_constant_acts_within_the_episode() -> None:
    choice = {"distribution": "choice", "values": [2.0], "operation": "scale"}
    spec = {"k_t": choice, "n": {"low": 0.5, "high": 1.5, "when": "interval", "interval": 1e-2}}
    p = plant(spec, 1)
    p.reset(seed=1)
    run(p, 11)
    ampere = p.batch.arrays.memory[0, K_M]
    assert ampere == pytest.approx(2.0 * 0.078 * p.drawn()["n"][0], rel=1e-12)


def test_a_drift_keeps_its_distribution_and_forgets_in_its_time() -> None:
    """The normal score at lag T correlates by exp(-1); at any time the spread is the declared."""
    drift = {"distribution": "normal", "mean": 1.0, "std": 0.1, "when": "drift"}
    p = plant({"k_b": drift | {"time_constant": 0.02}, "coulomb.d_cm": (0.9, 1.1)}, num := 1000)
    p.reset(seed=1)
    first, friction = p.drawn()["k_b"], p.drawn()["coulomb.d_cm"]
    run(p, 21)
    later = p.drawn()["k_b"]
    run(p, 100)
    last = p.drawn()["k_b"]
    exact = stats.truncnorm(-4, 4, 6000.0, 600.0)
    for values in (first, later, last):
        assert stats.kstest(values, exact.cdf).pvalue > 1e-3
    found = np.corrcoef(first, later)[0, 1]
    assert abs(np.arctanh(found) - np.arctanh(np.exp(-1.0))) < 4.0 / np.sqrt(num)
    assert abs(np.corrcoef(first, last)[0, 1]) < 4.0 / np.sqrt(num)
    np.testing.assert_array_equal(friction, p.drawn()["coulomb.d_cm"])


def test_a_slow_drift_is_updated_less_often_and_just_as_far() -> None:
    drift = {"distribution": "normal", "mean": 1.0, "std": 0.1, "when": "drift"}
    p = plant({"coulomb.d_cm": drift | {"time_constant": 5.0}}, NUM)
    p.reset(seed=1)
    first = p.drawn()["coulomb.d_cm"]
    changes = 0
    for _ in range(51):
        p.advance(np.zeros(NUM), np.zeros(NUM))
        changes += int(p.changed[0])
    assert changes == 10
    found = np.corrcoef(first, p.drawn()["coulomb.d_cm"])[0, 1]
    assert found == pytest.approx(np.exp(-0.01), abs=4.0 * (1 - np.exp(-0.02)) / np.sqrt(NUM))


# -------------------------------------------------------------------------------- seeding

ALL_WAYS: dict[str, Any] = {
    "k_b": {"distribution": "normal", "mean": 1.0, "std": 0.1, "group": "g"},
    "I_m": {"low": 0.8, "high": 1.2, "group": "g", "correlation": 0.5},
    "k_t": Variation(0.9, 1.1, when="once"),
    "coulomb.d_cm": Variation(0.5, 2.0, when="interval", interval=7e-3),
    "d_g": Variation(0.5, 2.0, "log_uniform", when="drift", time_constant=0.05),
    "command_delay.delay": {"low": 0.0, "high": 2e-3, "operation": "add"},
}


def test_a_member_of_a_batch_draws_what_it_would_alone() -> None:
    batch = plant(ALL_WAYS, 3)
    singles = [plant(ALL_WAYS, 1) for _ in range(3)]
    batch.reset(seed=20)
    for i, single in enumerate(singles):
        single.reset(seed=20 + i)
    for k in range(60):
        seen = batch.step(np.full(3, 10.0))
        for i, single in enumerate(singles):
            assert single.step(np.array([10.0])).tau[0] == seen.tau[i]
        if k == 30:
            batch.reset(mask=np.array([False, True, False]))
            singles[1].reset()
    for i, single in enumerate(singles):
        assert single.parameters(0) == batch.parameters(i)


def test_a_seed_repeats_everything() -> None:
    def trace(seed: int) -> Floats:
        p = plant(ALL_WAYS, 2)
        p.reset(seed=seed)
        return np.array([p.step(np.full(2, 10.0)).tau for _ in range(50)])

    np.testing.assert_array_equal(trace(4), trace(4))
    assert (trace(4)[-1] != trace(5)[-1]).all()


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


# ------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("spec", "error", "words"),
    [
        ("mildd", UnknownNameError, "Did you mean 'mild'"),
        (3, ConfigurationError, "name of a preset or a mapping"),
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


# -------------------------------------------------------------------- environments and runs


def test_reset_and_step_report_what_was_drawn() -> None:
    spec = {"k_b": (0.9, 1.1), "coulomb.d_cm": Variation(0.5, 2.0, when="interval", interval=5e-3)}
    arguments = {"effects": EFFECTS, "randomization": spec, "episode_steps": 12}
    single = gym.make("CJT/TorqueTracking-v0", **arguments)
    batch = gym.make_vec("CJT/TorqueTracking-v0", num_envs=2, **arguments)
    _, info = single.reset(seed=3)
    _, infos = batch.reset(seed=3)
    assert set(info["parameters"]) == {"k_b", "coulomb.d_cm"}
    told = []
    for k in range(12):
        _, _, _, over, info = single.step(np.zeros(1, dtype=np.float32))
        _, _, _, _, infos = batch.step(np.zeros((2, 1), dtype=np.float32))
        if "parameters" in info:
            told.append(k)
            assert infos["_parameters"].all()
            assert infos["parameters"]["coulomb.d_cm"][0] == info["parameters"]["coulomb.d_cm"]
    assert told == [5, 10]
    assert over
    _, info = single.reset()
    assert infos["_parameters"].all()
    assert infos["parameters"]["k_b"][0] == info["parameters"]["k_b"]


def test_options_fix_exact_parameters() -> None:
    env = gym.make("CJT/TorqueTracking-v0", effects=EFFECTS, randomization="mild")
    exact = {"k_b": 4321.0, "coulomb.d_cm": 1.25, "command_delay.delay": 1e-3}
    _, info = env.reset(seed=1, options={"parameters": exact})
    assert {name: info["parameters"][name] for name in exact} == exact
    assert info["parameters"]["I_m"] == 0.23
    p = env.unwrapped.episodes.plant  # type: ignore[attr-defined]
    same = SimulatedPlant(
        joint(
            effects=EFFECTS | {"coulomb": {"d_cm": 1.25}, "command_delay": {"delay": 1e-3}},
            k_b=4321.0,
        ),
        1,
    )
    for name in ("k_b", "d_cm", "d_cm_n", "command_delay", "I_m", "noise_tau"):
        assert p.batch.arrays.p[name][0] == same.batch.arrays.p[name][0]
    np.testing.assert_array_equal(p.batch.arrays.a, same.batch.arrays.a)
    _, info = env.reset()
    assert info["parameters"]["k_b"] != 4321.0
    for wrong, words in (
        ({"k_b": -1.0}, "> 0 N m/rad"),
        ({"k_b": float("nan")}, "finite"),
        ({"command_delay.delay": 0.5}, "at most"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            env.reset(options={"parameters": wrong})
    _, info = env.reset()
    assert 0.9 * 6000 <= info["parameters"]["k_b"] <= 1.1 * 6000


def test_a_run_folder_holds_every_variation_spelt_out(tmp_path: Path) -> None:
    spec = {"preset": "mild", "k_b": [0.8, 1.2], "I_m": {"distribution": "choice", "values": [1.0]}}
    config = TrainConfig(env={"effects": ["coulomb"], "randomization": spec})
    base = joint(effects=["coulomb"])
    begin_run(tmp_path / "run", config, base)
    saved = tomllib.loads((tmp_path / "run" / "randomization.toml").read_text())
    again = resolve_randomization(base, saved)
    assert again == resolve_randomization(base, spec)
    assert again["k_b"] == Variation(0.8, 1.2)
    assert saved["coulomb.d_cm"]["distribution"] == "uniform"
    begin_run(tmp_path / "run", config, base)


# ------------------------------------------------------------------------------ properties

BASE = load_joint(NAME, "full_dynamics", effects="all", parameters={"I_l": 0.5})
NAMES = variable_names(BASE)


@st.composite
def variations(draw: st.DrawFn) -> dict[str, Any]:
    """Return any specification, valid or not."""
    numbers = st.floats(-0.2, 3.0).map(lambda x: round(x, 3))
    kind = draw(st.sampled_from(["uniform", "log_uniform", "normal", "choice"]))
    spec: dict[str, Any] = {"distribution": kind}
    if kind == "choice":
        spec["values"] = draw(st.lists(numbers, min_size=1, max_size=3))
    elif kind == "normal":
        spec |= {"mean": draw(st.floats(0.5, 2.0)), "std": draw(st.floats(0.0, 0.3))}
    else:
        spec["low"], spec["high"] = sorted([draw(numbers), draw(numbers)])
    spec["operation"] = draw(st.sampled_from(["scale", "scale", "add", "set"]))
    spec["when"] = draw(st.sampled_from(["once", "reset", "interval", "drift"]))
    if spec["when"] == "interval":
        spec["interval"] = draw(st.floats(1e-3, 0.01))
    if spec["when"] == "drift":
        spec["time_constant"] = draw(st.floats(1e-3, 0.1))
    return spec


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.dictionaries(st.sampled_from(NAMES), variations(), max_size=4), st.integers(0, 2**40))
def test_values_never_leave_their_domain(spec: dict[str, Any], seed: int) -> None:
    """What is accepted is valid whatever is drawn, within episodes too; delays fit the ring."""
    try:
        p = SimulatedPlant(BASE, 3, randomization=spec)
    except CjtGymError:
        return
    for _ in range(2):
        p.reset(seed=seed)
        for k in range(20):
            for name, values in p.drawn().items():
                domain = find_target(BASE, name).domain
                assert domain.holds(values.min(), values.max()), name
            check_records(p.batch.arrays.p)
            depth = (p.batch.arrays.commands.shape[1] - 2) * p.dt * (1.0 + 1e-12)
            q = p.batch.arrays.p
            late = np.max([q[name] for name in CHANNEL_DELAYS], axis=0)
            assert (q["command_delay"] <= depth).all()
            assert (q["measurement_delay"] + late <= depth).all()
            p.batch.arrays.samples[:] = k + 1
            if p._plan.within:
                p.advance(np.zeros(3), np.zeros(3))
                p.batch.arrays.state[:] = 0.0


def check_records(q: Any) -> None:
    """The kernel's own parameters are valid: no negative damping, no body without inertia."""
    for name in ("I_m", "I_g", "I_l", "k_g", "k_b", "n", "k_t"):
        assert (q[name] > 0.0).all(), name
    for body in "mgl":
        assert (q[f"d_{body}"] >= 0.0).all()
        assert (q[f"d_{body}"] + q[f"d_{body}_extra_n"] >= -1e-9).all()
        assert (q[f"d_c{body}"] >= 0.0).all()
    assert all(np.isfinite(q[name]).all() for name in FIELDS)


def test_presets_and_plans_are_complete() -> None:
    assert set(PRESETS) == {"mild", "wide", "identified"}
    plan = compile_plan(BASE, resolve_randomization(BASE, "wide"), 1e-3)
    latest = max(CHANNEL_DELAYS, key=lambda name: plan.delays[name])
    assert not plan.within
    assert plan.longest == pytest.approx(sum(plan.delays[n] for n in ("measurement_delay", latest)))


@pytest.mark.parametrize("way", ["deepcopy", "pickle"])
def test_a_copy_draws_its_own_parameters(way: str) -> None:
    first = plant({"k_b": (0.5, 1.5), "coulomb.d_cm": (0.5, 1.5)})
    first.reset(seed=1)
    other = copy.deepcopy(first) if way == "deepcopy" else pickle.loads(pickle.dumps(first))
    before = first.batch.arrays.p["k_b"].copy()
    other.redraw()
    assert (other.batch.arrays.p["k_b"] == other.drawn()["k_b"]).all()
    assert (other.batch.arrays.p["k_b"] != before).all()
    np.testing.assert_array_equal(first.batch.arrays.p["k_b"], before)
    first.redraw()
    np.testing.assert_array_equal(first.batch.arrays.p, other.batch.arrays.p)
    np.testing.assert_array_equal(first.batch.arrays.a, other.batch.arrays.a)
