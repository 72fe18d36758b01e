"""Policies as matrix products give what torch gives, and run on a joint on a bus."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.records import read_record
from cjt_gym.training.deploy.fast_policy import fast_policy
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import PolicyConfig, TrainConfig
from cjt_gym.training.learning.policy import agent_of, load_policy
from cjt_gym.training.learning.run_folder import RunFolder

CONFIG = """
[bus]
interface = "virtual"
channel = "policy"
[drive]
protocol = "odrive"
node = 1
reports = "cyclic"
cycle_ms = 1
[sensors.torque]
protocol = "dbc"
file = "torque_sensor"
[joint]
file = "orange_80_6000"
structure = "output_fixed_rigid_gearbox"
effects = ["coulomb"]
[control]
rate_hz = 1000
"""


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_gives_what_torch_gives(algorithm: str, activation: str, tiny: TrainConfig) -> None:
    options = tiny.algorithm_options if algorithm == "PPO" else {"buffer_size": 100}
    policy = PolicyConfig(net_arch=(16, 8), activation=activation)
    config = replace(tiny, algorithm=algorithm, policy=policy, algorithm_options=options)
    env = make_environment(config)
    env.reset()
    for _ in range(20):  # so that the statistics of the observations are some
        env.step(np.zeros((config.num_envs, 1), np.float32))
    agent = agent_of("one", config, make_model(config, env), env)
    act = fast_policy(agent)
    size = agent.model.observation_space.shape
    assert size is not None
    observations = np.random.default_rng(0).normal(size=(50, *size), scale=3.0).astype(np.float32)
    wanted = agent.act(observations)
    found = np.array([act(observation) for observation in observations])
    np.testing.assert_allclose(found, wanted, atol=2e-6)


def test_policy_of_a_run_drives_a_joint_on_a_bus(finished: RunFolder, tmp_path: Path) -> None:
    config, out = tmp_path / "joint.toml", tmp_path / "run.csv"
    config.write_text(CONFIG)
    words = ["hardware", str(config), "--emulated", "--policy", str(finished.path)]
    assert main([*words, "--reference", "smooth", "--duration", "0.5", "--out", str(out)]) == 0
    record = read_record(out)
    assert record.provenance["policy"] == str(finished.path)
    assert len(record) > 500
    agent = load_policy(finished.path)
    assert agent.kind == "residual"
    # the base controller makes most of the torque
    assert np.corrcoef(record["tau_cmd"][200:500], record["tau_ref"][200:500])[0, 1] > 0.5
