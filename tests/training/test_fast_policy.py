"""Policies as matrix products give what torch gives, and run on a joint on a bus."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.records import read_record
from cjt_gym.training.deploy.fast_policy import fast_policy
from cjt_gym.training.learning.config import TrainConfig
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.run_folder import RunFolder
from tests.training.test_deploy import agent_for

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
    agent = agent_for(tiny, algorithm, activation)
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
