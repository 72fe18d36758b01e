"""Runs are listed and compared, and have a page; a training can go on from another."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cjt_gym.cli import main
from cjt_gym.errors import CjtGymError
from cjt_gym.training.evaluation.metrics import rmse
from cjt_gym.training.evaluation.rollout import ControllerAgent, run_episodes
from cjt_gym.training.learning.algorithms import make_environment, make_model
from cjt_gym.training.learning.config import VALIDATION_SEEDS, TrainConfig, environment_arguments
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.run_page import write_run_page
from cjt_gym.training.learning.runs import row_of
from cjt_gym.training.learning.train import start_from, train


def test_runs_are_listed_best_first_with_what_differs(
    finished: RunFolder, tiny: TrainConfig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = train(replace(tiny, seed=7, total_steps=1024), tmp_path / "other", quiet=True)
    assert main(["runs", str(finished.path), str(tmp_path), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {row["run"] for row in rows} == {str(finished.path), str(other.path)}
    errors = [row["best_rmse"] for row in rows]
    assert errors == sorted(errors)
    differs = next(row["differs"] for row in rows if row["differs"])
    assert set(differs) == {"seed", "total_steps"}
    assert main(["runs", str(finished.path)]) == 0
    assert "finished" in capsys.readouterr().out


def test_what_differs_is_listed_in_short_lines(
    finished: RunFolder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    long = {"env.parameters": list(range(500)), **{f"option_{k}": k for k in range(40)}}
    rows = [row_of(finished) | {"differs": long}]
    monkeypatch.setattr("cjt_gym.commands.runs.compared", lambda _: rows)
    assert main(["runs", str(finished.path)]) == 0
    text = capsys.readouterr().out
    assert "option_39 = 39" in text
    assert max(map(len, text.splitlines()[2:])) <= 100


def test_nothing_to_list_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(tmp_path)]) == 2
    assert "There is no training run in" in capsys.readouterr().err
    assert main(["runs", str(tmp_path / "gone")]) == 2


@pytest.mark.slow
def test_page_of_a_run_has_its_curve_its_figures_and_its_origin(finished: RunFolder) -> None:
    text = write_run_page(finished, episodes=2).read_text(encoding="utf-8")
    assert text.count("<svg") == 2
    for word in ("pd_feedforward", "chirp", "parameter hash", "total_steps = 2048"):
        assert word in text


@pytest.mark.slow
def test_a_page_compares_policy_and_base_on_the_same_episodes(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    gains = {"kp": 3.0}
    config = replace(tiny, total_steps=1024, env={**tiny.env, "base_gains": gains})
    run = train(config, tmp_path / "run", quiet=True)
    text = write_run_page(run, episodes=2).read_text(encoding="utf-8")
    idle = run_episodes(
        ControllerAgent("pd_feedforward"),  # gives zero actions to the base of the training
        environment_arguments(config.env),
        config.evaluation.episodes,
        VALIDATION_SEEDS,
    )
    assert f"pd_feedforward alone has {rmse(idle):.3g} N m there" in text


@pytest.mark.slow
def test_training_goes_on_from_the_best_model_of_another(
    finished: RunFolder, tiny: TrainConfig, tmp_path: Path
) -> None:
    options = {**tiny.algorithm_options, "learning_rate": 1e-12}
    config = replace(tiny, start_from=str(finished.path), algorithm_options=options)
    further = load_policy(train(config, tmp_path / "further", quiet=True).path)
    before = load_policy(finished.path)
    size = before.model.observation_space.shape
    seen = np.random.default_rng(0).normal(size=(20, *(size or ()))).astype(np.float32)
    actions = [agent.model.predict(seen, deterministic=True)[0] for agent in (before, further)]
    np.testing.assert_allclose(*actions, atol=1e-5)
    assert further.normalizer is not None
    assert further.normalizer.obs_rms.count > before.normalizer.obs_rms.count  # type: ignore[union-attr]


@pytest.mark.slow
def test_training_that_goes_on_keeps_the_optimiser_and_a_model_that_it_cannot_beat(
    tiny: TrainConfig, tmp_path: Path
) -> None:
    strong = replace(tiny, total_steps=1024, env={**tiny.env, "action_scale": 60.0})
    first_run = train(strong, tmp_path / "first", quiet=True)
    config = replace(strong, start_from=str(first_run.path))
    env = make_environment(config)
    model = make_model(config, env)
    start_from(str(first_run.path), config, model, env)
    state = model.policy.optimizer.state_dict()["state"]
    assert state
    assert all(float(moments["step"]) > 0 for moments in state.values())
    options = {**tiny.algorithm_options, "learning_rate": 1.0}
    spoiling = replace(config, algorithm_options=options)
    run = train(spoiling, tmp_path / "spoilt", quiet=True)
    first, *others = [row["validation_rmse"] for row in run.progress()]
    assert all(2.0 * first < error for error in others)
    before, after = (load_policy(path).model.policy for path in (first_run.path, run.path))
    for one, other in zip(before.parameters(), after.parameters(), strict=True):
        assert one.equal(other)


def test_network_of_another_size_is_refused(
    finished: RunFolder, tiny: TrainConfig, tmp_path: Path
) -> None:
    config = replace(tiny, start_from=str(finished.path), env={**tiny.env, "history": 9})
    with pytest.raises(CjtGymError, match=r"size of the observation of .* must be that of this"):
        train(config, tmp_path / "out", quiet=True)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["TQC", "RecurrentPPO"])
def test_further_algorithms_learn_and_are_loaded(
    algorithm: str, tiny: TrainConfig, tmp_path: Path
) -> None:
    off = {"buffer_size": 2000, "learning_starts": 100, "train_freq": 64, "batch_size": 64}
    options = off if algorithm == "TQC" else tiny.algorithm_options
    config = replace(tiny, algorithm=algorithm, algorithm_options=options, total_steps=1024)
    agent = load_policy(train(config, tmp_path / "run", quiet=True).path)
    size = agent.model.observation_space.shape or ()
    seen = np.random.default_rng(0).normal(size=(3, *size)).astype(np.float32)
    first = agent.act(seen)
    second = agent.act(seen)
    assert (algorithm == "RecurrentPPO") == bool(np.any(first != second))
    agent.begin()
    np.testing.assert_array_equal(agent.act(seen), first)
