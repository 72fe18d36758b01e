"""The benchmark: what it reports, and that it is fair."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.errors import ConfigurationError, UnknownNameError
from cjt_gym.joint import load_joint_file, to_toml
from cjt_gym.training.benchmark import make_agents, write_rows
from cjt_gym.training.evaluation.conditions import (
    EVALUATION_SEEDS,
    TASKS,
    Conditions,
    realistic_conditions,
    task_reference,
)
from cjt_gym.training.evaluation.evaluate import SEED_BLOCK, evaluate, first_seed
from cjt_gym.training.evaluation.rollout import ControllerAgent, joint_of, rollout
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.tuning.problem import Search

KEYS = {
    *("controller", "kind", "joint", "structure", "task", "rmse", "nrmse", "bandwidth_hz"),
    *("overshoot", "settling_s", "effort_rms", "noise_amplification", "episodes", "ci95"),
}
JOINT = "orange_80_6000"


@pytest.mark.slow
def test_the_json_has_the_agreed_keys(finished: RunFolder, tmp_path: Path) -> None:
    agents = make_agents(["open_loop"], [finished.path])
    conditions = realistic_conditions(JOINT)
    results = [evaluate(agent, conditions, ("step", "smooth"), episodes=3) for agent in agents]
    told = [row.to_json() for one in results for row in one.rows]
    rows = json.loads(write_rows(told, tmp_path).read_text())
    assert len(rows) == 4
    assert {row["kind"] for row in rows} == {"classical", "residual"}
    for row in rows:
        assert set(row) >= KEYS
        assert row["joint"] == JOINT
        assert row["episodes"] == 3
        low, high = row["ci95"]
        assert 0.0 < low <= row["rmse"] <= high
        assert row["terminated"] == 0.0
    assert (tmp_path / "benchmark.txt").read_text().count("\n") == 5


def test_the_same_seed_repeats_and_feedback_helps() -> None:
    agents = make_agents(["open_loop", "pd_feedforward"], [])
    conditions = realistic_conditions(JOINT)
    (open_loop,), (feedback,) = (evaluate(a, conditions, ("smooth",), 4).rows for a in agents)
    assert evaluate(agents[0], conditions, ("smooth",), 4).rows == (open_loop,)
    assert feedback.rmse < 0.9 * open_loop.rmse
    assert open_loop.noise_amplification == 0.0
    assert feedback.bandwidth_hz > open_loop.bandwidth_hz


@pytest.mark.parametrize("task", TASKS)
def test_every_agent_meets_the_same_references_joints_and_noise(task: str) -> None:
    conditions = realistic_conditions(JOINT)
    reference = task_reference(task, conditions.amplitude)
    one, other = (
        rollout(ControllerAgent(name), conditions, reference, 50, 3, EVALUATION_SEEDS)
        for name in ("open_loop", "pd_feedforward")
    )
    np.testing.assert_array_equal(one.reference, other.reference)
    np.testing.assert_array_equal(one.tau_measured[:, 0], other.tau_measured[:, 0])
    assert np.ptp(one.reference, axis=0).max() > 0.0 or task == "chirp"


def test_tasks_and_seeds_of_the_benchmark_share_no_episode() -> None:
    first = sorted(first_seed(task, seed) for task in BENCHMARK_TASKS for seed in range(20))
    assert first[0] == EVALUATION_SEEDS
    assert np.diff(first).min() == SEED_BLOCK


def test_conditions_take_structure_and_drive_of_the_joint_file(tmp_path: Path) -> None:
    file = replace(load_joint_file(JOINT), structure="output_fixed", drive="static")
    path = tmp_path / "found.toml"
    path.write_text(to_toml(file), encoding="utf-8")
    for stated in (Conditions(str(path)), realistic_conditions(str(path), randomization="mild")):
        joint = joint_of(stated)
        assert (stated.structure, stated.drive) == (joint.structure, joint.drive)
        assert (joint.structure, joint.drive) == ("output_fixed", "static")
    given = Conditions(str(path), "rigid_gearbox", drive="current")
    assert (given.structure, given.drive) == ("rigid_gearbox", "current")
    assert Conditions(JOINT).structure == "output_fixed_rigid_gearbox"
    assert Search("pd_feedforward", str(path)).structure == "output_fixed"


def test_bad_requests_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="Name at least one"):
        make_agents([], [])
    with pytest.raises(ConfigurationError, match="'open_loop' twice"):
        make_agents(["open_loop", "open_loop"], [])
    with pytest.raises(UnknownNameError, match="Did you mean 'open_loop'"):
        make_agents(["open_lop"], [])
    (agent,) = make_agents(["open_loop"], [])
    with pytest.raises(UnknownNameError, match="Did you mean 'smooth'"):
        evaluate(agent, realistic_conditions(JOINT), ("smoth",))
    with pytest.raises(ConfigurationError, match="episodes must be"):
        evaluate(agent, realistic_conditions(JOINT), TASKS, episodes=0)
    with pytest.raises(ConfigurationError, match="torque_amplitude"):
        evaluate(agent, realistic_conditions("emps", "rigid"))
