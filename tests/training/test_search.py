"""The search of hyperparameters."""

from __future__ import annotations

from pathlib import Path

import pytest

from cjt_gym.disk import to_toml
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.learning.config import TrainConfig, load_config

pytest.importorskip("optuna")

from cjt_gym.training.learning.search import SPACE, Plan, best_of, changed, own_value, search

RECIPE = load_config("quiet_residual")


def test_values_are_put_where_they_were_read() -> None:
    values = {place: SPACE[place][-1] for place in SPACE}
    config = changed(RECIPE, values)
    assert {place: own_value(config, place) for place in SPACE} == values
    assert config.policy.net_arch == (128, 128)
    assert config.algorithm_options["learning_rate"] == {"start": 2e-3, "end": pytest.approx(2e-4)}
    assert config.env["reward_weights"]["smoothness"] == 8.0
    kept = {place: own_value(RECIPE, place) for place in SPACE}
    assert changed(RECIPE, kept).env == RECIPE.env


@pytest.mark.slow
def test_a_search_tries_the_recipe_first_and_goes_on(tiny: TrainConfig, tmp_path: Path) -> None:
    env = {**tiny.env, "joint": RECIPE.env["joint"], "structure": RECIPE.env["structure"]}
    options = {**tiny.algorithm_options, "learning_rate": 1e-3}
    config = tiny.with_changes(env=env, algorithm_options=options)
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(to_toml(config.to_dict()), encoding="utf-8")
    plan = {"recipe": str(recipe), "out": tmp_path / "out", "steps": 1024, "episodes": 2}
    first = search(Plan(**plan, against="pd_feedforward", trials=1))  # type: ignore[arg-type]
    assert first.trials[0].params["policy.net_arch"] == "16"
    again = search(Plan(**plan, against="pd_feedforward", trials=2))  # type: ignore[arg-type]
    assert len(again.trials) == 2
    assert again.trials[0].value == first.trials[0].value
    best = best_of(again)
    assert (best is not None) == (tmp_path / "out" / "best.toml").is_file()
    if best is not None:
        assert load_config(tmp_path / "out" / "best.toml").total_steps == config.total_steps


def test_a_search_without_trials_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="--trials must be >= 1"):
        search(Plan("quiet_residual", tmp_path, trials=0))
