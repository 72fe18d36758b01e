"""Everything that is compared, from the plan to plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.training.benchmark.grid import Cell, make_cells, run_grid
from cjt_gym.training.benchmark.results import write_benchmark
from experiments.results.jobs import Job, run_jobs
from experiments.results.plan import (
    TASKS,
    Plan,
    Say,
    other_joints,
    train_all,
)
from experiments.results.port import port_energy
from experiments.results.score import (
    Result,
    iqm,
    policies_score,
    ratio,
    score,
    split,
    summary_of,
)
from experiments.results.shift import errors_under
from experiments.results.worst_case import worst_case

BEST: Final = 3
"""How many controllers take part where not all do, the best first; and the policies' base."""
DELAYS: Final = (1e-3, 2e-3, 3e-3, 4e-3)
"""On top of that of the command [s]."""
WIDE: Final = 2.0
"""Ranges of the parameters over those of the benchmark."""
GENERATIONS, PLACES, WORST_EPISODES = 12, 12, 4
"""Of the search for the worst joint: generations, joints of each, episodes of each joint."""


def run_results(plan: Plan, say: Say = lambda text: None) -> list[dict[str, Any]]:
    """Train and compare; return what came of each structure, as plain data.

    Raises:
        CjtGymError: The recipe, the joint or a run cannot be used.
    """
    train_all(plan, say)
    found = []
    for structure in plan.structures:
        cells = _cells(plan, structure)
        folder = plan.out / structure
        told = run_grid(cells, folder / "cells", plan.jobs, "loky", lambda result: None)
        write_benchmark(told, folder, [f"{plan.joint}, {plan.episodes} episodes of every task."])
        done = [r for r in told if r["status"] == "done"]
        one = summary_of(structure, done)
        one["base"] = plan.base(structure)
        say(f"{structure}: {len(done)} agents met")
        few = _few(cells, one)
        one["shifts"] = _shifts(plan, few, folder)
        say(f"{structure}: wider box and more delay")
        one["joints"] = _joints(plan, structure, cells, one["base"], folder)
        say(f"{structure}: other joints")
        one["worst"] = _worst(few, folder, plan.jobs)
        say(f"{structure}: worst cases")
        one["port"] = _port(cells, folder, plan.jobs)
        say(f"{structure}: energy at the output")
        found.append(one)
    return found


def _cells(plan: Plan, structure: str) -> list[Cell]:
    laws = [name for name, row in CONTROLLERS.items() if not row.renders]
    runs = plan.runs(structure)
    return make_cells(laws, runs, [plan.joint], [structure], TASKS, [0], plan.episodes)


def _few(cells: Sequence[Cell], found: Mapping[str, Any]) -> list[Cell]:
    """Return the cells of the policies, of the best controllers and of the base."""
    order = sorted((n for n in found["score"] if n != "policy"), key=found["score"].get)
    names = {*order[:BEST], found["base"]}
    return [cell for cell in cells if cell.is_policy or cell.agent in names]


def _shifts(plan: Plan, few: Sequence[Cell], folder: Path) -> list[dict[str, Any]]:
    """Return scores in a wider box and under more delay."""
    cases: list[tuple[str, dict[str, float]]]
    cases = [("as in the benchmark", {}), ("box twice as wide", {"box": WIDE})]
    cases += [(f"{1e3 * d:g} ms more delay", {"delay": d}) for d in DELAYS]
    jobs = [Job(errors_under, cell, options) for _, options in cases for cell in few]
    results = run_jobs(jobs, folder / "shifts", plan.jobs)
    rows = []
    for k, (name, options) in enumerate(cases):
        same = results[k * len(few) : (k + 1) * len(few)]
        late = {} if "box" in options else {"delay": options.get("delay", 0.0)}
        rows.append(_compare(name, same) | late)
    return rows


def _joints(
    plan: Plan, structure: str, cells: Sequence[Cell], base: str | None, folder: Path
) -> list[dict[str, Any]]:
    """Return scores on joints that no training saw; every controller has its gains for them."""
    names = other_joints(plan.joint, structure)
    jobs = [Job(errors_under, replace(cell, joint=name)) for name in names for cell in cells]
    results = run_jobs(jobs, folder / "joints", plan.jobs)
    count = len(cells)
    return [
        _compare(name, results[k * count : (k + 1) * count], base) for k, name in enumerate(names)
    ]


def _compare(case: str, results: Sequence[Result], base: str | None = None) -> dict[str, Any]:
    """Return the scores of policies and controllers in a case, and the policies' ratios.

    Args:
        case: Its name.
        results: Of `errors_under`.
        base: Controller to which the policies are compared beside the best.
    """
    done = [r for r in results if r["status"] == "done"]
    learned, classical = split(done)
    scores = {r["agent"]: score(r) for r in classical}
    others = {r["agent"]: r["why"] for r in results if r["status"] != "done"}
    found: dict[str, Any] = {"case": case, "score": scores, "without": others}
    if not learned or not classical:
        return found
    best = min(classical, key=lambda r: scores[r["agent"]])
    found["score"] = {"policy": policies_score(learned), **scores}
    found |= {"best": best["agent"], "ratio": ratio(learned, best)}
    same = [r for r in classical if r["agent"] == base]
    return found | ({"over_base": ratio(learned, same[0])} if same else {})


def _worst(few: Sequence[Cell], folder: Path, processes: int) -> dict[str, Any]:
    """Return errors at the middle of the box and at the worst place that was found."""
    options = {"generations": GENERATIONS, "places": PLACES}
    cells = [replace(cell, episodes=WORST_EPISODES) for cell in few]
    results = run_jobs(
        [Job(worst_case, cell, options) for cell in cells], folder / "worst", processes
    )
    learned, classical = split([r for r in results if r["status"] == "done"])
    found = {r["agent"]: {k: r[k] for k in ("middle", "worst", "where")} for r in classical}
    if learned:
        bad = max(learned, key=lambda r: float(r["worst"]))
        means = {k: iqm(np.array([r[k] for r in learned])) for k in ("middle", "worst")}
        found["policy"] = {**means, "where": bad["where"], "most": bad["worst"]}
    return {"agents": found, "without": _without(results)}


def _port(cells: Sequence[Cell], folder: Path, processes: int) -> dict[str, Any]:
    """Return the damping felt at the output, by agent and frequency."""
    results = run_jobs([Job(port_energy, cell) for cell in cells], folder / "port", processes)
    learned, classical = split([r for r in results if r["status"] == "done"])
    found = {r["agent"]: {"resistance": r["resistance"]} for r in classical}
    if learned:
        by_frequency = {f: [r["resistance"][f] for r in learned] for f in learned[0]["resistance"]}
        found["policy"] = {
            "resistance": {f: float(np.mean(values)) for f, values in by_frequency.items()},
            "least": {f: min(values) for f, values in by_frequency.items()},
        }
    return {"agents": found, "without": _without(results)}


def _without(results: Sequence[Result]) -> dict[str, str]:
    return {r["agent"]: r["why"] for r in results if r["status"] != "done"}
