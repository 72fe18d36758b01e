"""Gymnasium's own wrappers of vector environments work on a batch."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import RecordVideo, TransformAction, TransformObservation, TransformReward
from gymnasium.wrappers import vector as wrappers

import cjt_gym  # noqa: F401
from cjt_gym.errors import CjtGymError

Wrapped = Callable[[VectorEnv[Any, Any, Any]], Any]
STEPS = 12
ONE = np.float32(1.0)


WRAPPERS: dict[str, Wrapped] = {
    "VectorizeTransformObservation": lambda env: wrappers.VectorizeTransformObservation(
        env, TransformObservation, func=lambda x: x, observation_space=None
    ),
    "VectorizeTransformAction": lambda env: wrappers.VectorizeTransformAction(
        env, TransformAction, func=lambda x: 0.5 * x, action_space=env.single_action_space
    ),
    "VectorizeTransformReward": lambda env: wrappers.VectorizeTransformReward(
        env, TransformReward, func=lambda r: 2.0 * r
    ),
    "DictInfoToList": wrappers.DictInfoToList,
    "TransformObservation": lambda env: wrappers.TransformObservation(env, lambda x: 2.0 * x),
    "FlattenObservation": wrappers.FlattenObservation,
    "ReshapeObservation": lambda env: wrappers.ReshapeObservation(
        env, (*env.single_observation_space.shape, 1)
    ),
    "RescaleObservation": lambda env: wrappers.RescaleObservation(env, -ONE, ONE),
    "DtypeObservation": lambda env: wrappers.DtypeObservation(env, np.float16),
    "NormalizeObservation": wrappers.NormalizeObservation,
    "TransformAction": lambda env: wrappers.TransformAction(env, lambda a: 0.5 * a),
    "ClipAction": wrappers.ClipAction,
    "RescaleAction": lambda env: wrappers.RescaleAction(env, -ONE, ONE),
    "TransformReward": lambda env: wrappers.TransformReward(env, lambda r: 2.0 * r),
    "ClipReward": lambda env: wrappers.ClipReward(env, -1.0, 0.0),
    "NormalizeReward": wrappers.NormalizeReward,
    "RecordEpisodeStatistics": wrappers.RecordEpisodeStatistics,
}
NEEDS_NEXT_STEP = [name for name in WRAPPERS if name.endswith("Observation")]
ELSEWHERE = {
    "RecordVideo": "below, with moviepy",
    "HumanRendering": "below, with pygame",
    "ArrayConversion": "below, with torch",
    "NumpyToTorch": "below, with torch",
    "JaxToNumpy": "for environments that compute with JAX",
    "JaxToTorch": "for environments that compute with JAX",
    "FilterObservation": "for observations that are dictionaries",
    "GrayscaleObservation": "for observations that are images",
    "ResizeObservation": "for observations that are images",
}


def make(autoreset: str, **arguments: Any) -> VectorEnv[Any, Any, Any]:
    return gym.make_vec(
        "CJT/TorqueTracking-v0", num_envs=2, episode_steps=5, autoreset=autoreset, **arguments
    )


def run(env: Any) -> Any:
    """Step through two ends of episodes; return the last step."""
    env.reset(seed=0)
    rng, step = np.random.default_rng(0), None
    for _ in range(STEPS):
        step = env.step(rng.uniform(-1.0, 1.0, (2, 1)).astype(np.float32))
    env.close()
    return step


def test_no_wrapper_is_forgotten() -> None:
    assert {*WRAPPERS, *ELSEWHERE} == set(wrappers.__all__)


@pytest.mark.filterwarnings("ignore:.*precision lowered:UserWarning")  # DtypeObservation's own
@pytest.mark.parametrize("autoreset", ["next_step", "same_step"])
@pytest.mark.parametrize("name", WRAPPERS)
def test_wrapper_works_on_a_batch(name: str, autoreset: str) -> None:
    if autoreset == "same_step" and name in NEEDS_NEXT_STEP:
        with pytest.raises((ValueError, AssertionError), match=r"NEXT_STEP|next-step"):
            WRAPPERS[name](make(autoreset))
        return
    observation, reward, terminated, truncated, info = run(WRAPPERS[name](make(autoreset)))
    assert np.isfinite(observation).all()
    assert reward.shape == terminated.shape == truncated.shape == (2,)
    assert len(info) > 0


@pytest.mark.parametrize("name", ["ArrayConversion", "NumpyToTorch"])
def test_torch_goes_in_and_out(name: str) -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("array_api_compat")
    extra = {"ArrayConversion": {"env_xp": np, "target_xp": torch}}.get(name, {})
    env = getattr(wrappers, name)(make("next_step"), **extra)
    env.reset(seed=0)
    observation, *_ = env.step(torch.zeros((2, 1)))
    assert isinstance(observation, torch.Tensor)


def test_statistics_of_episodes_are_those_of_the_rewards() -> None:
    env = wrappers.RecordEpisodeStatistics(make("next_step"))
    env.reset(seed=0)
    total = np.zeros(2)
    for _ in range(5):
        _, reward, _, truncated, info = env.step(np.full((2, 1), 0.2, np.float32))
        total += reward
    assert truncated.all()
    np.testing.assert_allclose(info["episode"]["r"], total)
    assert info["episode"]["l"].tolist() == [5, 5]


def test_next_step_is_same_step_with_a_pause_bit_for_bit() -> None:
    """Also what is drawn in later episodes."""
    drifting = {"low": 0.5, "high": 2.0, "when": "interval", "interval": 2e-3}
    arguments = {
        "effects": ["coulomb", "noise"],
        "base_controller": "pid+reference",
        "randomization": {"k_b": (0.8, 1.2), "coulomb.d_cm": drifting},
    }
    pausing, other = make("next_step", **arguments), make("same_step", **arguments)
    seen, _ = pausing.reset(seed=3)
    np.testing.assert_array_equal(other.reset(seed=3)[0], seen)
    for _ in range(4):
        for k in range(5):
            action = np.full((2, 1), 0.1 * k, np.float32)
            last, reward, _, ended, info = pausing.step(action)
            begun, gain, _, over, facts = other.step(action)
            np.testing.assert_array_equal(reward, gain)
            np.testing.assert_array_equal(ended, over)
        assert ended.all()
        np.testing.assert_array_equal(last, np.stack(facts["final_obs"]))
        seen, reward, _, ended, info = pausing.step(np.ones((2, 1), np.float32))
        np.testing.assert_array_equal(seen, begun)
        assert not reward.any()
        assert not ended.any()
        np.testing.assert_array_equal(info["parameters"]["k_b"], facts["parameters"]["k_b"])


def test_members_that_go_on_are_not_disturbed_by_one_that_begins_anew() -> None:
    pausing = make("next_step", effects=["noise"])
    alone = gym.make("CJT/TorqueTracking-v0", effects=["noise"], episode_steps=1000)
    pausing.reset(seed=8)
    alone.reset(seed=9)
    pausing.unwrapped.episodes.plant.batch.arrays.samples[0] += 3  # type: ignore[attr-defined]
    for _ in range(5):
        seen, *_ = pausing.step(np.full((2, 1), 0.3, np.float32))
        one, *_ = alone.step(np.full(1, 0.3, np.float32))
        np.testing.assert_array_equal(seen[1], one)


def test_another_mode_is_refused() -> None:
    with pytest.raises(CjtGymError, match=r"Unknown autoreset 'nextstep'.*next_step"):
        make("nextstep")


@pytest.mark.slow
def test_videos_are_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    single = gym.make("CJT/TorqueTracking-v0", render_mode="rgb_array", episode_steps=3)
    batch = make("next_step", render_mode="rgb_array")
    for env, wrapper in ((single, RecordVideo), (batch, wrappers.RecordVideo)):
        folder = tmp_path / wrapper.__module__
        film = wrapper(env, str(folder), video_length=3, step_trigger=lambda k: k == 0)
        film.reset(seed=0)
        for _ in range(4):
            film.step(film.action_space.sample())
        film.close()
        assert [p.suffix for p in folder.iterdir()] == [".mp4"]


def test_a_batch_is_shown_in_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
    pytest.importorskip("pygame")
    pytest.importorskip("cv2")
    run(wrappers.HumanRendering(make("next_step", render_mode="rgb_array")))
