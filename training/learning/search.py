"""Hyperparameters by a stated search.

    python -m cjt_gym.training.learning.search RECIPE --trials N

Optuna's TPE (Akiba et al., 2019, Optuna: A Next-generation Hyperparameter Optimization Framework)
tries values of `SPACE` in a recipe. A trial trains briefly and runs the kinds of references that
it was trained on, on validation draws that neither trainings nor evaluations see. Its value is the
nrmse, geometric mean over these tasks; it is feasible if its command at rest is no noisier
than that of a classical controller on the same draws. The first trial is the recipe as it stands.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import optuna
from optuna.trial import FrozenTrial

from cjt_gym.disk import to_toml, write_text
from cjt_gym.errors import CjtGymError, ConfigurationError, check_range
from cjt_gym.training.evaluation.conditions import TASKS, realistic_conditions
from cjt_gym.training.evaluation.evaluate import evaluate
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent
from cjt_gym.training.learning.config import BASE_GAINS, TrainConfig, from_dict, load_config
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.train import train

VALIDATION: Final = 1
"""Which block of held-out episodes the search sees; comparisons take block 0."""
SPACE: Final[dict[str, tuple[Any, ...]]] = {
    "policy.noise_weight": (0.001, 0.002, 0.004, 0.008),
    "env.reward_weights.smoothness": (0.05, 1.0, 2.0, 4.0, 8.0),
    "env.action_scale": (3.0, 9.0, 18.0, 36.0),
    "env.history": (4, 8, 16),
    "algorithm_options.gamma": (0.9, 0.95, 0.98),
    "algorithm_options.learning_rate": (5e-4, 1e-3, 2e-3),
    "algorithm_options.n_epochs": (4, 8, 16),
    "policy.net_arch": ("64 64", "128 128"),
}
"""What is tried beside the recipe's own value, by its place there.

Actions are in N m; a learning rate falls to a tenth; networks are texts of their widths.
"""


@dataclass(frozen=True)
class Plan:
    """How large a search is."""

    recipe: str  # configuration to begin from
    out: Path = Path("search")  # folder of the search; an interrupted search is resumed
    structure: str | None = None  # structure that replaces that of the recipe
    base: str | None = None  # controller or gain file that replaces that of the recipe
    against: str = "lqg"  # controller whose noise is the limit
    trials: int = 10  # how many in all, those of an earlier call too
    steps: int = 500_000  # of each training
    episodes: int = 8  # of each task
    seed: int = 0  # of the sampler


def own_value(config: TrainConfig, place: str) -> Any:
    """Return what a configuration has at a place such as "policy.net_arch", as in `SPACE`."""
    value: Any = config.to_dict()
    for key in place.split("."):
        value = (value or {}).get(key)
    if place.endswith("learning_rate") and isinstance(value, Mapping):
        return value["start"]
    return " ".join(map(str, value)) if place.endswith("net_arch") else value


def changed(config: TrainConfig, values: Mapping[str, Any]) -> TrainConfig:
    """Return a configuration with values as in `SPACE` put at their places; None leaves one."""
    data: dict[str, Any] = config.to_dict()
    for place, value in values.items():
        *path, name = place.split(".")
        table = data
        for key in path:
            table[key] = dict(table.get(key) or {})
            table = table[key]
        if name == "learning_rate":
            table[name] = {"start": value, "end": 0.1 * value}
        elif value is not None:
            table[name] = [int(n) for n in value.split()] if name == "net_arch" else value
    return from_dict(data, "the search")


def measured(agent: Agent, config: TrainConfig, episodes: int) -> tuple[float, float]:
    """Return nrmse, geometric mean over the tasks, and noise amplification on validation draws."""
    conditions = realistic_conditions(config.env["joint"], config.env["structure"])
    rows = evaluate(agent, conditions, TASKS, episodes, VALIDATION).rows
    score = math.exp(sum(math.log(row.nrmse) for row in rows) / len(rows))
    return score, rows[0].noise_amplification


def search(plan: Plan) -> optuna.Study:
    """Run the trials that are missing, write `best.toml` if one is feasible; return the study."""
    for name in ("trials", "steps", "episodes"):
        check_range(f"--{name}", getattr(plan, name), low=1)
    config = _prepared(plan)
    space = {place: _choices(config, place) for place in SPACE}
    plan.out.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=f"sqlite:///{plan.out / 'study.db'}",
        study_name="search",
        sampler=optuna.samplers.TPESampler(seed=plan.seed),
        load_if_exists=True,
    )
    if "classical" not in study.user_attrs:
        limits = measured(ControllerAgent(plan.against), config, plan.episodes)
        if math.isnan(limits[1]):
            raise ConfigurationError(
                f"The noise of {plan.against} must set the limit, but the torque sensor of "
                f"{config.env['joint']} has none. Choose another joint."
            )
        study.set_user_attr("classical", limits)
        study.enqueue_trial({place: row[0] for place, row in space.items()})
    score, limit = study.user_attrs["classical"]

    def objective(trial: optuna.Trial) -> float:
        values = {place: trial.suggest_categorical(place, row) for place, row in space.items()}
        run = plan.out / f"trial_{trial.number}"
        shutil.rmtree(run, ignore_errors=True)
        policy = load_policy(train(changed(config, values), run, quiet=True).path)
        value, noise = measured(policy, config, plan.episodes)
        trial.set_constraint("noise", noise - limit)
        text = f"error {value / score:.3f} of {plan.against}, noise {noise:.2f} (of {limit:.2f})"
        sys.stderr.write(f"trial {trial.number}: {text}, {json.dumps(values)}\n")
        return value

    done = sum(trial.state.is_finished() for trial in study.trials)
    study.optimize(objective, n_trials=max(0, plan.trials - done), catch=(CjtGymError,))
    best = best_of(study)
    if best is not None:
        made = changed(_prepared(plan, shortened=False), best.params)
        write_text(plan.out / "best.toml", to_toml(made.to_dict()))
    return study


def best_of(study: optuna.Study) -> FrozenTrial | None:
    """Return the trial of the smallest error among those within the limit of noise, if any is."""
    kept = [t for t in study.trials if t.value is not None and t.constraints["noise"] <= 0.0]
    return min(kept, key=lambda trial: float(trial.value or 0.0), default=None)


def _prepared(plan: Plan, shortened: bool = True) -> TrainConfig:
    config = load_config(plan.recipe)
    given = {"structure": plan.structure, "base_controller": plan.base}
    env = {**config.env, **{name: word for name, word in given.items() if word is not None}}
    if plan.base is not None:
        env.pop(BASE_GAINS, None)
    return config.with_changes(env=env, total_steps=plan.steps if shortened else None)


def _choices(config: TrainConfig, place: str) -> tuple[Any, ...]:
    return tuple(dict.fromkeys((own_value(config, place), *SPACE[place])))


def main(arguments: Sequence[str] | None = None) -> int:
    """Search, and say which trial was the best."""
    parser = argparse.ArgumentParser(description="Search the hyperparameters of a recipe.")
    add = parser.add_argument
    add("recipe", metavar="RECIPE", help="configuration to begin from")
    text = "folder of the search; an interrupted search is resumed"
    add("--out", type=Path, default=Plan.out, help=text)
    add("--structure", help="replaces that of the recipe")
    add("--base", help="controller or gain file that replaces that of the recipe")
    add("--against", default=Plan.against, help="controller whose noise is the limit")
    add("--trials", type=int, default=Plan.trials)
    add("--steps", type=int, default=Plan.steps, help="of each training")
    add("--episodes", type=int, default=Plan.episodes, help="of each task")
    add("--seed", type=int, default=Plan.seed, help="of the sampler")
    plan = Plan(**vars(parser.parse_args(arguments)))
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        best = best_of(search(plan))
    except CjtGymError as error:
        sys.stderr.write(f"search: {error}\n")
        return 2
    found = "no trial meets the noise limit"
    if best is not None:
        found = f"trial {best.number}, nrmse {best.value:.4f}: {plan.out / 'best.toml'}"
    sys.stdout.write(found + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
