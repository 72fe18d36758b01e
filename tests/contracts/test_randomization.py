"""Every distribution, operation and group of randomised joints."""

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
from scipy import special, stats

from cjt_gym import load_joint
from cjt_gym.errors import CjtGymError, ConfigurationError, UnknownNameError
from cjt_gym.joint.batch import CHANNEL_DELAYS
from cjt_gym.joint.configure import FIELDS
from cjt_gym.plant import SimulatedPlant, Variation
from cjt_gym.plant.randomization import PRESETS, resolve_randomization, variable_names
from cjt_gym.plant.randomization.draw import normal_quantile
from cjt_gym.plant.randomization.program import compile_plan
from cjt_gym.plant.randomization.target import find_target
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.run_folder import begin_run
from tests.contracts.randomized import EFFECTS, NAME, NUM, drawn, joint, plant

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
    with pytest.raises(UnknownNameError, match="k_bb"):
        env.reset(options={"parameters": {"k_bb": 1.0}})
    with pytest.raises(UnknownNameError, match="parameters"):
        env.reset(options={"parameter": {"k_b": 1.0}})
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


@pytest.mark.slow
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
