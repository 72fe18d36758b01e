"""Runs: what they leave behind, how they go on, and how they stop."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.baselines.gains import write_gains
from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError, MissingFileError
from cjt_gym.joint import load_joint
from cjt_gym.training.evaluation.conditions import Conditions
from cjt_gym.training.evaluation.rollout import run_episodes
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.callbacks import load_replay, restore, save_replay
from cjt_gym.training.learning.config import PolicyConfig, TrainConfig, environment_arguments
from cjt_gym.training.learning.distributed import train_seeds
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.run_folder import (
    RunFolder,
    TrainingError,
    begin_run,
    open_run,
)
from cjt_gym.training.learning.train import train


def test_a_run_folder_holds_what_is_needed_to_repeat_it(
    finished: RunFolder, tiny: TrainConfig
) -> None:
    facts = finished.facts
    assert facts["status"] == "finished"
    assert facts["steps"] == 2048
    assert facts["seed"] == tiny.seed
    assert len(facts["parameter_hash"]) == 64
    assert {"python", "numpy", "torch", "stable-baselines3"} <= set(facts["versions"])
    assert "git_revision" in facts
    assert json.loads(json.dumps(finished.config.to_dict())) == json.loads(
        json.dumps(tiny.to_dict())
    )
    names = {path.name for path in finished.path.iterdir()}
    assert {"config.toml", "run.json", "model.zip", "normalization.npz", "tensorboard"} <= names
    assert [path.name for path in finished.checkpoints()] == [
        "step_000000001024",
        "step_000000002048",
    ]
    assert any((finished.path / "tensorboard").iterdir())
    rows = finished.progress()
    assert [row["steps"] for row in rows] == [1024, 2048]
    assert all(row["validation_rmse"] > 0.0 and row["rmse"] > 0.0 for row in rows)


def test_a_run_keeps_the_gains_of_its_gain_file(tiny: TrainConfig, tmp_path: Path) -> None:
    gains, out = {"kp": 0.3, "kd": 0.004, "lead": 1.0}, tmp_path / "run"
    path = write_gains(tmp_path / "pid.toml", "pd_feedforward", gains, {})
    config = replace(tiny, env={**tiny.env, "base_controller": str(path)})
    joint = load_joint("orange_80_6000", "output_fixed_rigid_gearbox")
    begin_run(out, config, joint)
    assert begin_run(out, config, joint).path == out, "the same configuration goes on"
    write_gains(path, "pd_feedforward", {**gains, "kp": 0.2}, {})
    with pytest.raises(ConfigurationError, match="differs in env"):
        begin_run(out, config, joint)
    path.unlink()
    law = environment_arguments(open_run(out).config.env)["base_controller"](joint, 1e-3)
    assert (law.kp, law.kd) == (0.3, 0.004)


@pytest.mark.parametrize("structure", ["output_fixed_rigid_gearbox", "full_dynamics"])
def test_a_joint_with_all_effects_and_everything_randomised_trains(
    structure: str, tiny: TrainConfig, tmp_path: Path
) -> None:
    env = {**tiny.env, "structure": structure, "effects": "all", "randomization": "mild"}
    run = train(replace(tiny, env=env), tmp_path / "run", quiet=True)
    assert run.facts["status"] == "finished"
    assert all(np.isfinite(row["validation_rmse"]) for row in run.progress())
    assert "spring_hysteresis.tau_h" in (run.path / "randomization.toml").read_text()


def test_a_finished_run_says_so_and_stays_as_it_is(
    finished: RunFolder, tiny: TrainConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (finished.path / "run.json").read_bytes()
    train(tiny, finished.path)
    assert "is finished (2048 steps). Nothing to do." in capsys.readouterr().err
    assert (finished.path / "run.json").read_bytes() == before


def test_tensorboard_has_the_tracking_error(finished: RunFolder) -> None:
    event_accumulator = pytest.importorskip(
        "tensorboard.backend.event_processing.event_accumulator"
    )
    events = event_accumulator.EventAccumulator(str(finished.path / "tensorboard"))
    events.Reload()
    assert {"tracking/rmse_Nm", "validation/rmse_Nm"} <= set(events.Tags()["scalars"])


def test_the_policy_of_a_run_is_batched_and_deterministic(finished: RunFolder) -> None:
    policy = load_policy(finished.path)
    assert policy.kind == "residual"
    assert policy.name == "tiny"
    rng = np.random.default_rng(0)
    size = policy.model.observation_space.shape
    assert size is not None
    observations = rng.normal(size=(5, *size)).astype(np.float32)
    actions = policy.act(observations)
    assert actions.shape == (5, 1)
    assert np.abs(actions).max() <= 1.0
    np.testing.assert_array_equal(actions, policy.act(observations))
    for i in range(5):
        np.testing.assert_allclose(actions[i], policy.act(observations[i : i + 1])[0], atol=1e-6)


def test_the_best_model_is_the_one_that_validated_best(finished: RunFolder) -> None:
    from cjt_gym.training.evaluation.metrics import rmse
    from cjt_gym.training.learning.config import VALIDATION_SEEDS, environment_arguments

    policy = load_policy(finished.path)
    arguments = environment_arguments(finished.config.env)
    error = rmse(run_episodes(policy, arguments, 4, VALIDATION_SEEDS))
    assert error == pytest.approx(finished.facts["best_validation_rmse"], rel=1e-5)
    assert error == pytest.approx(min(r["validation_rmse"] for r in finished.progress()), rel=1e-5)


def test_a_policy_runs_on_another_joint_but_not_at_another_rate(finished: RunFolder) -> None:
    policy = load_policy(finished.path)
    arguments = policy.arguments(Conditions("lemon_50_6000", "output_fixed"))
    traces = run_episodes(policy, arguments | {"episode_steps": 20}, 2, 0)
    assert np.isfinite(traces.tau).all()
    with pytest.raises(ConfigurationError, match="dt_control = 0.001 s"):
        policy.arguments(Conditions("lemon_50_6000", dt_control=2e-3))


@pytest.mark.parametrize(
    ("asked", "taken"), [(100, 104), (1, 8), (600, 1024)], ids=["short", "one", "two rollouts"]
)
def test_a_training_takes_the_steps_asked_for_or_says_how_many_instead(
    tiny: TrainConfig,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    asked: int,
    taken: int,
) -> None:
    run = train(replace(tiny, total_steps=asked), tmp_path / "run")
    assert run.facts["steps"] == taken
    told = capsys.readouterr().err
    assert f"{taken} steps instead of {asked}" in told
    assert f"{taken} of {taken} steps" in told.splitlines()[-1]
    assert f"validation rmse {run.facts['best_validation_rmse']:.3g} N m" in told


@pytest.mark.slow
def test_a_killed_run_goes_on_from_its_last_checkpoint(tiny: TrainConfig, tmp_path: Path) -> None:
    config = replace(tiny, total_steps=400_000)
    (tmp_path / "long.toml").write_text(to_toml(config.to_dict()), encoding="utf-8")
    code = (
        "from cjt_gym.training.learning.config import load_config\n"
        "from cjt_gym.training.learning.train import train\n"
        "train(load_config('long.toml'), 'run', quiet=True)\n"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env=environment)
    deadline = time.monotonic() + 400.0
    folder = tmp_path / "run"
    while len(list(folder.glob("checkpoints/step_*"))) < 2 and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    run = open_run(folder)
    assert run.facts["status"] == "running"
    reached = int(run.checkpoints()[-1].name.removeprefix("step_"))
    assert reached >= 2048
    shorter = replace(config, total_steps=reached + 1024)
    (folder / "config.toml").write_text(to_toml(shorter.to_dict()), encoding="utf-8")
    again = train(shorter, folder, quiet=True)
    assert again.facts["status"] == "finished"
    assert again.facts["begun_times"] == 2
    assert again.facts["steps"] == reached + 1024
    steps = [row["steps"] for row in again.progress()]
    assert steps == sorted(set(steps))
    assert steps[-1] == reached + 1024


def test_a_checkpoint_restores_weights_optimiser_and_statistics(
    finished: RunFolder, tiny: TrainConfig
) -> None:
    env = make_environment(tiny)
    model = make_model(tiny, env)
    place = finished.checkpoints()[-1]
    assert restore(model, env, place)["steps"] == model.num_timesteps == 2048
    policy = load_policy(finished.path, checkpoint=place)
    for one, other in zip(model.policy.parameters(), policy.model.policy.parameters(), strict=True):
        assert bool((one == other).all())
    optimiser = model.policy.optimizer.state_dict()["state"]
    assert optimiser
    assert policy.normalizer is not None
    np.testing.assert_array_equal(
        env.obs_rms.mean,
        policy.normalizer.obs_rms.mean,  # type: ignore[attr-defined,union-attr]
    )


def test_sac_trains_and_keeps_its_replay_buffer(tmp_path: Path) -> None:
    config = TrainConfig(
        algorithm="SAC",
        total_steps=400,
        num_envs=4,
        checkpoint_every=200,
        env={"episode_steps": 50},
        policy=PolicyConfig(net_arch=(8,)),
        algorithm_options={"buffer_size": 1000, "learning_starts": 100, "batch_size": 32},
    )
    run = train(config, tmp_path / "sac", quiet=True)
    assert run.facts["status"] == "finished"
    env = make_environment(config)
    model = make_model(config, env)
    place = run.checkpoints()[-1]
    restore(model, env, place)
    save_replay(model, tmp_path / "again.npz")
    other = make_model(config, make_environment(config))
    load_replay(other, tmp_path / "again.npz")
    with np.load(place / "replay.npz") as one, np.load(tmp_path / "again.npz") as two:
        assert len(one["actions"]) == 100
        for name in one.files:
            np.testing.assert_array_equal(one[name], two[name])
    assert load_policy(run.path).kind == "learned"


def test_a_training_that_diverges_stops_with_the_reason(tiny: TrainConfig, tmp_path: Path) -> None:
    options = {**tiny.algorithm_options, "learning_rate": 1e30}
    config = replace(tiny, algorithm_options=options)
    with pytest.raises(TrainingError, match="Lower learning_rate"):
        train(config, tmp_path / "run", quiet=True)
    facts = open_run(tmp_path / "run").facts
    assert facts["status"] == "failed"
    assert "Lower learning_rate" in facts["reason"]


def test_folders_that_are_not_ours_are_refused(
    finished: RunFolder, tiny: TrainConfig, tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigurationError, match="is not a run folder of cjt-gym"):
        train(tiny, tmp_path, quiet=True)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(ConfigurationError, match=r"another configuration \(it differs in seed\)"):
        train(replace(tiny, seed=3), finished.path, quiet=True)
    with pytest.raises(ConfigurationError, match="is not a run folder"):
        load_policy(tmp_path)
    with pytest.raises(MissingFileError, match="does not exist"):
        load_policy(tmp_path / "nowhere")
    with pytest.raises(ConfigurationError, match="exported with --to numpy"):
        load_policy(tmp_path / "notes.txt")


@pytest.mark.slow
def test_a_training_stops_early_where_nothing_becomes_better(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    look = replace(tiny.evaluation, every=512, patience=2)
    options = {**tiny.algorithm_options, "learning_rate": 1e-12}
    config = replace(tiny, total_steps=20_000, evaluation=look, algorithm_options=options)
    run = train(config, tmp_path / "run", quiet=True)
    assert run.facts["status"] == "finished"
    assert run.facts["reason"] == "2 evaluations in a row without a better model"
    assert run.facts["steps"] < 20_000
    assert (run.path / "model.zip").is_file()


@pytest.mark.slow
def test_several_seeds_train_side_by_side(tiny: TrainConfig, tmp_path: Path) -> None:
    short = replace(tiny, total_steps=512)
    runs = sorted(train_seeds(short, tmp_path / "run", seeds=2, jobs=2), key=lambda run: run.path)
    assert [run.path.name for run in runs] == ["run_0", "run_1"]
    assert [run.facts["seed"] for run in runs] == [tiny.seed, tiny.seed + 1000]
    assert all(run.facts["status"] == "finished" for run in runs)
    assert runs[0].progress()[-1]["rmse"] != runs[1].progress()[-1]["rmse"]
    with pytest.raises(ConfigurationError, match="must be >= 1"):
        next(train_seeds(short, tmp_path / "run", seeds=0, jobs=1))
