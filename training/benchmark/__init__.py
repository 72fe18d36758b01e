"""The benchmark: a grid of joints, structures, tasks, controllers and policies, and its report.

Here are its agents, and its rows as text.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from cjt_gym.disk import write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.training.evaluation.rollout import Agent, ControllerAgent

COLUMNS = (
    ("controller", "controller", "{}"),
    ("task", "task", "{}"),
    ("rmse [N m]", "rmse", "{:.3f}"),
    ("95 % interval", "ci95", "{0[0]:.3f} .. {0[1]:.3f}"),
    ("nrmse", "nrmse", "{:.3f}"),
    ("bandwidth [Hz]", "bandwidth_hz", "{:.1f}"),
    ("overshoot", "overshoot", "{:.2f}"),
    ("settling [s]", "settling_s", "{:.3f}"),
    ("effort [N m]", "effort_rms", "{:.2f}"),
    ("noise", "noise_amplification", "{:.2f}"),
)


def make_agents(controllers: Sequence[str], policies: Sequence[str | Path]) -> list[Agent]:
    """Return the agents to compare.

    Args:
        controllers: Names of `CONTROLLERS`, or gain files.
        policies: Run folders, or exported policies (.npz).

    Raises:
        ConfigurationError: There is none, or two have the same name.
        UnknownNameError: There is no such controller.
        MissingFileError: There is no such gain file or run.
    """
    agents: list[Agent] = [ControllerAgent(name) for name in controllers]
    if policies:
        from cjt_gym.training.deploy.shipped import load_agent

        agents += [load_agent(path) for path in policies]
    names = [agent.name for agent in agents]
    if not agents:
        raise ConfigurationError("Name at least one --controller or --policy to compare.")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ConfigurationError(
            f"Every controller and policy must have a different name, got {repeated[0]!r} twice. "
            "Leave one out, or rename the run folder."
        )
    return agents


def write_rows(rows: Sequence[Mapping[str, object]], out: Path) -> Path:
    """Write rows, as plain data, as `benchmark.json` and `benchmark.txt`; return the first."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / "benchmark.json"
    write_text(path, json.dumps(rows, indent=2) + "\n")
    write_text(out / "benchmark.txt", table(rows) + "\n")
    return path


def table(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows, as plain data, as a plain-text table."""
    return align(cells_of(rows))


def cells_of(rows: Sequence[Mapping[str, object]]) -> list[list[str]]:
    """Return rows, as plain data, as the cells of a table with a head."""
    varied = [n for n in ("joint", "structure", "where") if len({row.get(n) for row in rows}) > 1]
    return in_columns(rows, [*((name, name, "{}") for name in varied), *COLUMNS])


def in_columns(
    rows: Sequence[Mapping[str, object]], columns: Sequence[tuple[str, str, str]]
) -> list[list[str]]:
    """Return rows as the cells of a table; a column has a title, a key and a format."""
    cells = [[title for title, _, _ in columns]]
    for row in rows:
        cells.append(
            ["-" if row[key] is None else form.format(row[key]) for _, key, form in columns]
        )
    return cells


def align(cells: Sequence[Sequence[str]]) -> str:
    """Return cells as lines with aligned columns."""
    widths = [max(len(line[j]) for line in cells) for j in range(len(cells[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    )
