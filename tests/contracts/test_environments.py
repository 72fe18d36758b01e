"""Every environment keeps the promises of Gymnasium, of Stable-Baselines3 and its own."""

from __future__ import annotations

import hashlib
import inspect
import math
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

import cjt_gym
from cjt_gym.envs import TorqueTrackingEnv, TorqueTrackingVectorEnv
from cjt_gym.envs.arguments import DEFAULTS, complete
from cjt_gym.envs.current_control import CurrentControlEnv
from cjt_gym.envs.observation import ROWS
from cjt_gym.envs.observe import TERMS
from cjt_gym.envs.robot import RobotEnv
from cjt_gym.envs.sb3 import TorqueTrackingVecEnv
from cjt_gym.errors import ConfigurationError, ParameterError, UnknownNameError
from cjt_gym.registry import ENVIRONMENTS
from cjt_gym.signals import Signal
from tests.python import run_python

REAL = {
    "coulomb": {},
    "cogging": {"f": (480.0,), "a": (0.5,), "b": (0.2,)},
    "gear_ripple": {"f": (160.0,), "a": (0.02,), "b": (0.0,)},
    "command_delay": {"delay": 1.3e-3},
    "measurement_delay": {"delay": 1e-3},
    "noise": {},
    "quantization": {},
    "velocity_differentiation": {"cutoff": 200.0},
}
BATCHED = [name for name, row in ENVIRONMENTS.items() if "vector_entry_point" in row]
RANDOM = {"k_b": (0.8, 1.2), "coulomb.d_cm": (0.5, 2.0), "I_m": (0.9, 1.1)}


def make(name: str = "CJT/TorqueTracking-v0", **arguments: Any) -> gym.Env[Any, Any]:
    return gym.make(name, **arguments)


@pytest.mark.parametrize("name", BATCHED)
def test_both_checkers_pass_without_a_warning(name: str) -> None:
    env = make(name, effects=REAL, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        check_env_sb3(env.unwrapped)


def test_what_is_observed_is_told_in_the_documentation() -> None:
    env = make(preview=2, history=5).unwrapped
    layout = env.episodes.settings.layout  # type: ignore[attr-defined]
    names = layout.names()
    assert len(names) == layout.size == env.reset(seed=0)[0].size
    assert [names.count(name) for name in ROWS] == [3, 1, 1, 1, 5, 5, 5, 5]
    for told in (TorqueTrackingEnv, CurrentControlEnv, RobotEnv):
        assert "{observation}" not in (told.__doc__ or "")
    for row in ROWS.values():
        assert f"| {row.text} | {row.unit} |" in (TorqueTrackingEnv.__doc__ or "")


def test_the_last_value_of_an_array_holds() -> None:
    env = make(reference=np.linspace(0.0, 15.0, 20), preview=3, episode_steps=40)
    seen, _ = env.reset(seed=0)
    rows = [env.step(np.zeros(1, dtype=np.float32)) for _ in range(40)]
    wanted = np.append(np.linspace(0.0, 15.0, 20), np.full(24, 15.0))
    assert [row[4]["tau_reference"] for row in rows] == pytest.approx(wanted[1:41])
    scale = env.unwrapped.episodes.settings.layout.torque  # type: ignore[attr-defined]
    ahead = np.array([seen[:4], *(row[0][:4] for row in rows)]) * scale
    expected = np.lib.stride_tricks.sliding_window_view(wanted, 4)[:41]
    np.testing.assert_allclose(ahead, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "more"),
    [
        *((name, {}) for name in BATCHED),
        (BATCHED[0], {"drive": "dq", "randomization": "mild"}),  # with a current loop
    ],
)
def test_a_member_of_a_batch_equals_a_single_environment_bit_for_bit(
    name: str, more: dict[str, Any]
) -> None:
    arguments = {"effects": REAL, "randomization": RANDOM, "episode_steps": 60} | more
    batch = gym.make_vec(name, num_envs=3, **arguments)
    singles = [make(name, **arguments) for _ in range(3)]
    seen, _ = batch.reset(seed=11)
    for i, single in enumerate(singles):
        np.testing.assert_array_equal(seen[i], single.reset(seed=11 + i)[0])
    rng = np.random.default_rng(0)
    for _ in range(150):
        action = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        seen, reward, terminated, truncated, info = batch.step(action)
        for i, single in enumerate(singles):
            one, gain, end, late, facts = single.step(action[i])
            assert (gain, end, late) == (reward[i], terminated[i], truncated[i])
            assert facts["tau"] == info["tau"][i]
            if end or late:
                np.testing.assert_array_equal(info["final_obs"][i], one)
                one, _ = single.reset()
            np.testing.assert_array_equal(seen[i], one)


def trace(seed: int) -> bytes:
    env = make(effects=REAL, randomization=RANDOM)
    seen, _ = env.reset(seed=seed)
    rows = [seen]
    for k in range(100):
        rows.append(env.step(np.array([np.sin(0.1 * k)], dtype=np.float32))[0])
    return np.array(rows).tobytes()


def test_the_same_seed_repeats_in_another_process() -> None:
    program = (
        "from tests.contracts.test_environments import trace;"
        "import hashlib; print(hashlib.sha256(trace(7)).hexdigest())"
    )
    run = run_python(program)
    assert run.stdout.strip() == hashlib.sha256(trace(7)).hexdigest()
    assert trace(7) != trace(8)


def test_the_stable_baselines_batch_resets_within_the_step_and_keeps_the_last_observation() -> None:
    batch = TorqueTrackingVecEnv(2, effects=REAL, episode_steps=20)
    single = make(effects=REAL, episode_steps=20)
    batch.seed(3)
    seen = batch.reset()
    one, _ = single.reset(seed=3)
    np.testing.assert_array_equal(seen[0], one)
    action = np.full((2, 1), 0.3, dtype=np.float32)
    total = 0.0
    for _ in range(20):
        seen, reward, done, infos = batch.step(action)
        one, gain, _, _, _ = single.step(action[0])
        total += gain
    assert done.all()
    assert reward[0] == np.float32(gain)
    assert infos[0]["TimeLimit.truncated"] is True
    np.testing.assert_array_equal(infos[0]["terminal_observation"], one)
    assert infos[0]["episode"] == {"r": pytest.approx(total), "l": 20, "t": 0.0}
    np.testing.assert_array_equal(seen[0], single.reset()[0])


def test_every_step_reports_the_promised_keys_and_the_terms_sum_to_the_reward() -> None:
    env = make(effects=REAL, reward_weights={"effort": 0.1, "precision": 0.5})
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.array([0.5], dtype=np.float32))
    terms = [f"reward/{name}" for name in TERMS]
    plain = ["tau", "tau_measured", "tau_reference", "tau_command", "base_action", "residual"]
    assert set(info) == {*plain, *terms}
    assert reward == pytest.approx(sum(info[name] for name in terms))
    error = -info["reward/tracking"]
    assert error > 0.0
    expected = -0.5 * math.log1p(20.0 * error) / math.log(21.0)
    assert info["reward/precision"] == pytest.approx(expected)
    assert info["residual"] == info["tau_command"]
    assert info["base_action"] == 0.0


def test_the_first_reset_without_a_seed_is_random() -> None:
    firsts = [make().reset()[0] for _ in range(2)]
    assert not np.array_equal(*firsts)


def test_speed_beyond_the_peak_terminates_and_time_truncates() -> None:
    env = make("CJT/FullDynamics-v0", action_scale=150.0, episode_steps=400)
    env.reset(seed=0)
    for _ in range(400):
        _, _, terminated, truncated, info = env.step(np.ones(1, dtype=np.float32))
        if terminated or truncated:
            break
    assert terminated
    assert not truncated
    assert info["reward/safety"] == -50.0
    env = make(episode_steps=5)
    env.reset(seed=0)
    ends = [env.step(np.zeros(1, dtype=np.float32))[2:4] for _ in range(5)]
    assert ends == [(False, False)] * 4 + [(False, True)]


def test_the_reference_is_what_was_asked_for_and_its_preview_is_its_future() -> None:
    chirp = Signal("chirp", amplitude=3.0, low=1.0, high=9.0, period=0.5)
    env = make(reference=chirp, preview=2, torque_amplitude=10.0)
    seen, _ = env.reset(seed=0)
    for k in range(1, 50):
        ahead = seen[1:3]
        seen, _, _, _, info = env.step(np.zeros(1, dtype=np.float32))
        assert info["tau_reference"] == pytest.approx(float(chirp.torque(k * 1e-3)), abs=1e-12)
        assert seen[0] == ahead[0]
        assert seen[1] == ahead[1]


def test_a_reference_may_be_a_list_of_torques() -> None:
    listed, array = (make(reference=x) for x in ([1, 2, 3.5], np.array([1.0, 2.0, 3.5])))
    still = np.zeros(1, dtype=np.float32)
    for env in (listed, array):
        env.reset(seed=0)
    for wanted in (2.0, 3.5, 3.5):
        infos = [env.step(still)[4]["tau_reference"] for env in (listed, array)]
        assert infos == [wanted, wanted]


@pytest.mark.parametrize(
    "action", ["x", None, np.array(["x"]), np.array([np.nan]), np.zeros(2, np.float32)]
)
def test_an_action_of_other_than_finite_numbers_is_refused(action: Any) -> None:
    single, batch = make().unwrapped, gym.make_vec("CJT/TorqueTracking-v0", num_envs=2)
    for env in (single, batch):
        env.reset(seed=0)
        with pytest.raises(ConfigurationError, match="The action must hold"):
            env.step(action)


def test_a_batch_says_in_one_line_what_it_is() -> None:
    batch = TorqueTrackingVecEnv(3, joint="lemon_50_6000", base_controller="pid")
    assert repr(batch).startswith("<TorqueTrackingVecEnv: 3 episodes, <Joint lemon_50_6000: ")
    plant, law = batch.episodes.plant, batch.episodes.controller
    assert repr(plant).startswith("<SimulatedPlant: 3 joints, dt = 0.001 s, <Joint lemon_50_6000")
    assert repr(law).startswith("<LinearController pid: dt = 0.001 s, ")
    assert all("\n" not in repr(one) and len(repr(one)) < 200 for one in (batch, plant, law))


def test_nothing_hidden_is_observed() -> None:
    """Two joints that measure the same are observed the same, whatever their parameters."""
    arguments = {"reference": Signal("zero"), "torque_amplitude": 10.0}
    one, other = make(**arguments), make(**arguments)
    first = one.reset(seed=0)[0]
    second = other.reset(seed=0, options={"parameters": {"k_b": 4000.0, "I_m": 0.5}})[0]
    np.testing.assert_array_equal(first, second)
    still = np.zeros(1, dtype=np.float32)
    # Not bit for bit: rounding of another k_b times the angle is seen in the measured torque.
    np.testing.assert_allclose(one.step(still)[0], other.step(still)[0], atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"joint": "orang_80_6000"}, UnknownNameError, "orange_80_6000"),
        ({"structure": "rigit"}, UnknownNameError, "rigid"),
        ({"effects": ["coulom"]}, UnknownNameError, "coulomb"),
        ({"effects": ["cogging"]}, ParameterError, "cogging.f"),
        ({"reference": "chrip"}, UnknownNameError, "chirp"),
        ({"dt_physics": 3e-4}, ConfigurationError, "whole multiple"),
        ({"dt_control": 0.0}, ConfigurationError, "dt_control must be finite and > 0 s, got 0.0"),
        ({"preview": 1.5}, ConfigurationError, "preview must be a whole number >= 0, got 1.5"),
        ({"torque_amplitude": -1.0}, ConfigurationError, "> 0 N m"),
        ({"torque_amplitude": "6"}, ConfigurationError, "torque_amplitude must be .*, got '6'"),
        ({"history": "3"}, ConfigurationError, "history must be a whole number >= 0, got '3'"),
        ({"joint": None}, ConfigurationError, "joint must be the name of a joint or the path"),
        ({"parameters": 3}, ConfigurationError, "parameters must be a mapping"),
        ({"reward_weights": 3}, ConfigurationError, "reward_weights must be a mapping"),
        ({"effects": {"command_delay": {"delay": 8e-3}}, "history": 3}, ConfigurationError, ">= 8"),
        ({"randomization": {"k_b": (-1.0, 1.0)}}, ConfigurationError, "> 0"),
        ({"randomization": {"coulomb.d_cm": (0.5, 1.0)}}, UnknownNameError, "active effect"),
        ({"reward_weights": {"trackin": 1.0}}, UnknownNameError, "tracking"),
        ({"base_controller": 3}, ConfigurationError, "base_controller"),
        ({"joint": "emps", "structure": "rigid"}, ConfigurationError, "torque_amplitude"),
    ],
)
def test_bad_arguments_say_what_is_wrong(
    arguments: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        make(**arguments)


def test_an_unknown_argument_of_a_batch_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="structure"):
        gym.make_vec("CJT/TorqueTracking-v0", num_envs=2, strukture="rigid")


def test_importing_the_package_is_light() -> None:
    program = (
        "import sys, cjt_gym; print([m for m in ('torch', 'numba', 'scipy') if m in sys.modules])"
    )
    run = run_python(program)
    assert run.stdout.strip() == "[]"
    assert "load_joint" in dir(cjt_gym)


def test_every_name_of_the_package_is_there() -> None:
    assert {"diagnose", "examine", "read_log"} <= set(cjt_gym.__all__)
    assert all(callable(getattr(cjt_gym, name)) or name.isupper() for name in cjt_gym.__all__)


def test_arguments_are_declared_once() -> None:
    for target in (TorqueTrackingEnv, TorqueTrackingVectorEnv):
        known = dict(inspect.signature(target).parameters)
        assert {name: known[name].default for name in DEFAULTS} == DEFAULTS
        with pytest.raises(ConfigurationError, match="Did you mean 'preview'"):
            target(previev=2)
    page = TorqueTrackingEnv.__doc__ or ""
    assert all(f"| `{name}` |" in page for name in DEFAULTS)
    assert complete({"preview": 3}) == complete(complete({"preview": 3}))
