"""A training of two seconds, once for all tests that need one."""

from __future__ import annotations

import pytest

from cjt_gym.training.learning.config import EvaluationConfig, PolicyConfig, TrainConfig
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.train import train

TINY = TrainConfig(
    total_steps=2048,
    num_envs=8,
    checkpoint_every=1024,
    normalize_observations=True,
    env={
        "base_controller": "pd_feedforward",
        "effects": {"coulomb": {}, "noise": {}, "command_delay": {"delay": 1e-3}},
        "randomization": {"k_b": [0.9, 1.1]},
        "episode_steps": 60,
    },
    policy=PolicyConfig(net_arch=(16,), log_std_init=-1.0),
    algorithm_options={"n_steps": 64, "batch_size": 256, "n_epochs": 2},
    evaluation=EvaluationConfig(every=1024, episodes=4),
)


@pytest.fixture(scope="session")
def tiny() -> TrainConfig:
    return TINY


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return train(TINY, tmp_path_factory.mktemp("runs") / "tiny", quiet=True)
