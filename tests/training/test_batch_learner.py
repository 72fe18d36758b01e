"""Training on tensors with skrl."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from cjt_gym.baselines.gains import choose
from cjt_gym.training.gpu import make_episodes

pytest.importorskip("skrl")

from cjt_gym.training.gpu.batch_learner import SkrlEpisodes, learn, mean_reward


def test_what_the_learner_holds_does_not_change_behind_its_back() -> None:
    env = SkrlEpisodes(make_episodes(3, episode_steps=2), seed=4)
    observation, _ = env.reset()
    kept = observation.clone()
    for k in range(3):
        after, reward, terminated, truncated, _ = env.step(torch.zeros(3, 1))
        assert after.shape == kept.shape
        assert after.dtype == torch.float32
        assert reward.shape == terminated.shape == truncated.shape == (3, 1)
        assert bool(truncated.all()) == (k == 1)
    assert torch.equal(observation, kept)
    assert env.num_envs == 3
    assert env.device == torch.device("cpu")


def test_a_residual_policy_improves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    before, threads = torch.get_rng_state(), torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        episodes = make_episodes(
            64,
            structure="output_fixed_rigid_gearbox",
            effects={"coulomb": {}},
            base_controller=choose("pd_feedforward").make,
        )
        unaided = mean_reward(None, episodes, steps=300, seed=900_000)
        actor = learn(episodes, steps=384, seed=1)
        learned = mean_reward(actor, episodes, steps=300, seed=900_000)
    finally:
        torch.set_rng_state(before)
        torch.set_num_threads(threads)
    assert unaided < 0.0
    assert learned > 0.97 * unaided
    assert not list(tmp_path.iterdir())  # nothing is written where it runs
