"""When randomised joints are drawn: once, at intervals, as drifts, and from which seeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from cjt_gym.joint.kernel.arrays import K_M
from cjt_gym.plant import SimulatedPlant, Variation
from tests.contracts.randomized import NUM, Floats, joint, plant, run

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
