"""What the cells of a benchmark come to: rows, rankings, files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.disk import write_text
from cjt_gym.training.benchmark import align, table, write_rows
from cjt_gym.training.benchmark.page import ranking_cells, write_benchmark_report
from cjt_gym.training.evaluation.metrics import bootstrap_rms
from cjt_gym.training.evaluation.ranking import Place, rank

Result = Mapping[str, Any]
Group = tuple[str, str]
MEANS = ("bandwidth_hz", "overshoot", "settling_s", "noise_amplification", "terminated")


def place_of(result: Result) -> Group:
    """Return joint and structure of a cell's result."""
    return result["cell"]["joint"], result["cell"]["structure"]


def merge(results: Sequence[Result]) -> list[dict[str, Any]]:
    """Return the rows of the benchmark, the episodes of all seeds of a cell pooled.

    Bandwidth, overshoot, settling time and noise amplification are means over the seeds; null
    where one of them has none.
    """
    by_cell: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        if result["status"] == "done":
            by_cell.setdefault((*place_of(result), result["agent"]), []).append(result)
    return [
        _pool([next(row for row in r["rows"] if row["task"] == task) for r in same], same, task)
        for same in by_cell.values()
        for task in same[0]["squares"]
    ]


def _pool(rows: Sequence[Result], same: Sequence[Result], task: str) -> dict[str, Any]:
    squares = np.concatenate([r["squares"][task] for r in same])
    power = float(np.mean(np.concatenate([r["powers"][task] for r in same])))
    rmse = float(np.sqrt(np.mean(squares)))
    merged = dict(rows[0])
    for name in MEANS:
        values = [row[name] for row in rows]
        merged[name] = None if None in values else float(np.mean(values))
    merged["rmse"] = rmse
    merged["nrmse"] = rmse / math.sqrt(power) if power > 0.0 else None
    merged["effort_rms"] = float(np.sqrt(np.mean(np.square([row["effort_rms"] for row in rows]))))
    merged["episodes"] = len(squares)
    merged["effects"] = same[0]["effects"]
    merged["ci95"] = list(bootstrap_rms(squares))
    return merged


def rankings(results: Sequence[Result]) -> dict[Group, list[Place]]:
    """Return the ranking of every joint and structure, over all seeds.

    A controller that renders a spring has no part in it: it follows no torque.
    """
    groups: dict[Group, dict[str, dict[str, dict[str, list[float]]]]] = {}
    following = [r for r in results if r["status"] == "done" and not r["renders"]]
    for result in following or [r for r in results if r["status"] == "done"]:
        group = groups.setdefault(place_of(result), {})
        agent = group.setdefault(result["agent"], {"squares": {}, "powers": {}})
        for kind, tasks in agent.items():
            for task, values in result[kind].items():
                tasks.setdefault(task, []).extend(values)
    return {
        key: rank(
            {name: agent["squares"] for name, agent in group.items()},
            {name: agent["powers"] for name, agent in group.items()},
        )
        for key, group in groups.items()
    }


def write_benchmark(results: Sequence[Result], out: Path, facts: Sequence[str]) -> str:
    """Write `benchmark.json`, `benchmark.txt`, `ranking.json` and `report.html`; return a text."""
    rows, places = merge(results), rankings(results)
    write_rows(rows, out)
    plain = [
        {"joint": joint, "structure": structure, "ranking": [asdict(place) for place in ranked]}
        for (joint, structure), ranked in places.items()
    ]
    text = json.dumps(plain, indent=1) + "\n"
    write_text(out / "ranking.json", text)
    others = [r for r in results if r["status"] != "done"]
    groups = {key: _group(key, ranked, results, rows) for key, ranked in places.items()}
    write_benchmark_report(out / "report.html", groups, _without_seeds(others), facts)
    parts = [table(rows)]
    for (joint, structure), ranked in places.items():
        parts += ["", f"Ranking on {joint}, {structure}", align(ranking_cells(ranked))]
        parts.append(effects_in_force(results, joint, structure))
    return "\n".join(parts)


def effects_in_force(results: Sequence[Result], joint: str, structure: str) -> str:
    """Say which effects acted on a joint."""
    cells = [r for r in results if place_of(r) == (joint, structure)]
    names = next(r["effects"] for r in cells if r["status"] == "done")
    return f"Effects in force: {', '.join(names) or 'none'}"


def _group(
    key: Group, places: list[Place], results: Sequence[Result], rows: list[dict[str, Any]]
) -> tuple[list[Place], list[Result], list[dict[str, Any]]]:
    """Return a ranking, the first seed's cells in its order, those without rank last, its rows."""
    here = [r for r in results if place_of(r) == key]
    first: dict[str, Result] = {}
    for result in here:
        if result["status"] == "done":
            first.setdefault(result["agent"], result)
    ordered = [first[place.agent] for place in places]
    ordered += [result for result in first.values() if result not in ordered]
    return places, ordered, [r for r in rows if (r["joint"], r["structure"]) == key]


def _without_seeds(others: Sequence[Result]) -> list[Result]:
    """Return one cell for all seeds of what was refused or failed."""
    seen: dict[tuple[str, str, str], Result] = {}
    for other in others:
        seen.setdefault((other["agent"], *place_of(other)), other)
    return list(seen.values())
