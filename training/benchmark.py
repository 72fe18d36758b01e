"""The benchmark: classical and learned controllers side by side."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from cjt_gym.errors import ConfigurationError
from cjt_gym.training.conditions import TASKS, Conditions
from cjt_gym.training.evaluate import Evaluation, Row, evaluate
from cjt_gym.training.rollout import Agent, ControllerAgent

COLUMNS = (
    ("controller", "{}"),
    ("task", "{}"),
    ("rmse [N m]", "{:.3f}"),
    ("95 % interval", "{}"),
    ("nrmse", "{:.3f}"),
    ("bandwidth [Hz]", "{:.1f}"),
    ("overshoot", "{:.2f}"),
    ("settling [s]", "{:.3f}"),
    ("effort [N m]", "{:.2f}"),
    ("noise", "{:.2f}"),
)


def make_agents(controllers: Sequence[str], policies: Sequence[str | Path]) -> list[Agent]:
    """Return the agents to compare.

    Args:
        controllers: Names of `CONTROLLERS`.
        policies: Run folders.

    Raises:
        ConfigurationError: There is none, or two have the same name.
        UnknownNameError: There is no such controller.
        MissingFileError: There is no such run.
    """
    agents: list[Agent] = [ControllerAgent(name) for name in controllers]
    if policies:
        from cjt_gym.training.policy import load_policy

        agents += [load_policy(path) for path in policies]
    names = [agent.name for agent in agents]
    if not agents:
        raise ConfigurationError("Name at least one --controller or --policy to compare.")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ConfigurationError(
            f"Every controller and policy must have a name of its own, got {repeated[0]!r} twice. "
            "Leave one out, or rename the run folder."
        )
    return agents


def benchmark(
    agents: Sequence[Agent],
    conditions: Conditions,
    tasks: Sequence[str] = TASKS,
    episodes: int = 32,
    seed: int = 0,
    report: Callable[[str], None] = lambda text: None,
) -> list[Evaluation]:
    """Evaluate every agent on the same episodes."""
    return [evaluate(agent, conditions, tasks, episodes, seed, report) for agent in agents]


def rows_of(evaluations: Sequence[Evaluation]) -> list[Row]:
    """Return all rows."""
    return [row for evaluation in evaluations for row in evaluation.rows]


def write_results(evaluations: Sequence[Evaluation], out: Path) -> Path:
    """Write `benchmark.json` and `benchmark.txt` into a folder; return the first."""
    out.mkdir(parents=True, exist_ok=True)
    rows = rows_of(evaluations)
    path = out / "benchmark.json"
    text = json.dumps([row.to_json() for row in rows], indent=2)
    path.write_text(text + "\n", encoding="utf-8")
    (out / "benchmark.txt").write_text(table(rows) + "\n", encoding="utf-8")
    return path


def table(rows: Sequence[Row]) -> str:
    """Return rows as a plain-text table."""
    cells = [[title for title, _ in COLUMNS]]
    for row in rows:
        low, high = row.ci95
        values = (
            *(row.controller, row.task, row.rmse, f"{low:.3f} .. {high:.3f}", row.nrmse),
            *(row.bandwidth_hz, row.overshoot, row.settling_s, row.effort_rms),
            row.noise_amplification,
        )
        cells.append([form.format(v) for (_, form), v in zip(COLUMNS, values, strict=True)])
    return align(cells)


def align(cells: Sequence[Sequence[str]]) -> str:
    """Return cells as lines with aligned columns; what cannot be said is a dash."""
    shown = [["-" if cell in ("nan", "inf") else cell for cell in line] for line in cells]
    widths = [max(len(line[j]) for line in shown) for j in range(len(shown[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in shown
    )
