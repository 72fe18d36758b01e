"""The page of a run: how it learnt, what it does, and from what it came."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cjt_gym.datasheet.blocks import Block, Code
from cjt_gym.disk import to_toml
from cjt_gym.training import report
from cjt_gym.training.benchmark import cells_of
from cjt_gym.training.evaluation.conditions import TASKS
from cjt_gym.training.evaluation.evaluate import evaluate
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent
from cjt_gym.training.learning.config import base_of
from cjt_gym.training.learning.policy import load_policy
from cjt_gym.training.learning.policy_arguments import conditions_of
from cjt_gym.training.learning.run_folder import RunFolder
from cjt_gym.training.learning.validation import validation_error
from cjt_gym.training.report import figures

EPISODES = 16  # of each task: the page of a run takes seconds
SHOWN = ("step", "chirp")


def write_run_page(run: RunFolder, episodes: int = EPISODES) -> Path:
    """Write `page.html` into the folder of a run, and return its path.

    The policy, and its base controller alone, are run on episodes that the training did not see.
    """
    facts, config = run.facts, run.config
    agents: list[Agent] = [load_policy(run.path)]
    base = base_of(config.env)
    bases = [] if base is None else [ControllerAgent(base)]
    levels = {agent.name: validation_error(config, agent) for agent in bases}
    agents += bases
    tried = [evaluate(agent, conditions_of(config), TASKS, episodes) for agent in agents]
    parts: list[Block] = [
        report.paragraph(_summary(facts, levels)),
        report.figure(
            figures.learning_figure(run.progress(), levels),
            "Tracking error over the training: while it explores, and in validation, on episodes "
            "that it does not see. The base controller alone runs the same validation episodes. "
            "The model that was best there is kept.",
        ),
        report.heading("What it does"),
        report.html_table(cells_of([row.to_json() for e in tried for row in e.rows])),
        report.figure(
            figures.traces_figure({t: {e.agent: e.traces[t] for e in tried[::-1]} for t in SHOWN}),
            f"The same episode under each; {episodes} episodes of every task in the table.",
        ),
        report.heading("From what it came"),
        report.html_table([["", ""], *_origin(facts)]),
        Code(to_toml(config.to_dict())),
    ]
    return report.write_page(run.path / "page.html", f"Training run {run.path.name}", parts)


def _summary(facts: dict[str, Any], levels: Mapping[str, float]) -> str:
    why = f" ({facts['reason']})" if facts.get("reason") else ""
    best = facts.get("best_validation_rmse")
    beside = "".join(f"; {name} alone has {error:.3g} N m there" for name, error in levels.items())
    found = "" if best is None else f" Best error in validation: {best:.3g} N m{beside}."
    return (
        f"{facts['joint']}, {str(facts['structure']).replace('_', ' ')}. Status: {facts['status']}"
        f"{why} after {facts['steps']:,} steps and {facts.get('seconds', 0.0):.0f} s.{found}"
    )


def _origin(facts: dict[str, Any]) -> list[list[str]]:
    rows = [["begun", facts["begun"]], ["seed", str(facts["seed"])]]
    if "effects" in facts:
        rows += [["effects in force", ", ".join(facts["effects"]) or "none"]]
    rows += [["git revision", str(facts["git_revision"])]]
    rows += [["parameter hash", facts["parameter_hash"][:16]]]
    return rows + [[name, number] for name, number in facts["versions"].items()]
