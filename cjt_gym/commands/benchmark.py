"""`cjt-gym benchmark`: controllers and policies on the same joints, tasks and seeds."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from cjt_gym import __version__
from cjt_gym.baselines import CONTROLLERS
from cjt_gym.baselines.table import CONTROLLER_HELP
from cjt_gym.console import Answer
from cjt_gym.console.options import (
    add_conditions,
    check_randomize,
    drive_of,
    effect_words,
    structures_of,
    tell_effects,
)
from cjt_gym.errors import CjtGymError, ConfigurationError, check_range
from cjt_gym.joint import load_joint_file
from cjt_gym.joint.effect_words import parse_effects
from cjt_gym.records.repair_notes import counted
from cjt_gym.training.benchmark.cluster import BACKENDS
from cjt_gym.training.benchmark.grid import Cell, make_cells, run_grid
from cjt_gym.training.evaluation.rollout import joint_of
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS

ALL = "all"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to compare, on what, where to run it, and where to write it."""
    add = parser.add_argument
    add("--joint", nargs="+", required=True, metavar="J", help="joints, or paths of joint files")
    text = "friction, sensors and what the joint file lists, ripple, delays (docs/benchmark.md)"
    add_conditions(parser, several=True, effects=text)
    text = f"{CONTROLLER_HELP}; gain files of `cjt-gym tune`; or {ALL} of the table"
    add("--controller", nargs="+", default=[], metavar="C", help=text)
    text = "run folders, exported policies (.npz), or names of  cjt-gym policies"
    add("--policy", nargs="+", default=[], metavar="RUN", help=text)
    text = f"{', '.join(BENCHMARK_TASKS)}; default: all for the structure but current_loop"
    add("--task", nargs="+", metavar="T", help=text)
    text = "amplitude of the references [N m]; default: from the peak torque"
    add("--amplitude", type=float, help=text)
    add("--episodes", type=int, default=32, help="episodes per task and seed, default 32")
    add("--seed", type=int, default=0, help="first seed of the episodes, default 0")
    add("--seeds", type=int, default=1, help="number of consecutive seeds, default 1")
    add("--jobs", type=int, default=1, help="parallel processes, -1 for one per core")
    text = "where cells run: processes here, or a cluster; default loky"
    add("--backend", default="loky", metavar="B", help=f"{', '.join(BACKENDS)}: {text}")
    text = "folder for the results; an interrupted benchmark is resumed"
    add("--out", type=Path, required=True, metavar="DIR", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Compare; write rows, ranking and report; print the table."""
    cells = _cells(options)
    for conditions in {(c.joint, c.structure): c.conditions() for c in cells}.values():
        tell_effects(joint_of(conditions))
    from tqdm import tqdm

    from cjt_gym.training.benchmark.results import merge, write_benchmark

    with tqdm(total=len(cells), file=sys.stderr, unit="cell", disable=None) as bar:

        def count(result: dict[str, Any]) -> None:
            cell = result["cell"]
            bar.set_postfix_str(f"{result['agent']}, {cell['joint']}, {cell['structure']}")
            bar.update()

        kept = options.out / "cells"
        results = run_grid(cells, kept, options.jobs, options.backend, count)
    _tell(results)
    text = write_benchmark(results, options.out, _facts(options, results))
    return merge(results), text


def _cells(options: argparse.Namespace) -> list[Cell]:
    controllers = list(CONTROLLERS) if options.controller == [ALL] else options.controller
    check_range("--seeds", options.seeds, low=1)
    words = effect_words(options)
    asked = {
        "effects": None if words is None else tuple(words),
        "randomization": check_randomize(options),
    }
    parse_effects(words)
    cells = []
    for joint in options.joint:
        structures = structures_of(joint, options.structure)
        cells += make_cells(
            controllers,
            options.policy,
            [joint],
            structures,
            _tasks(options, structures, bool(controllers)),
            range(options.seed, options.seed + options.seeds),
            options.episodes,
            amplitude=options.amplitude,
            drive=drive_of(joint, options.drive),
            **asked,
        )
    return cells


def _tasks(options: argparse.Namespace, structures: list[str], has_controllers: bool) -> list[str]:
    if options.task is not None:
        return list(options.task)
    tasks = [
        name
        for name, row in BENCHMARK_TASKS.items()
        if not row.open_loop_only and any(row.applies(structure) for structure in structures)
    ]
    if has_controllers:
        return tasks
    return [name for name in tasks if not BENCHMARK_TASKS[name].classical_only]


def _tell(results: list[dict[str, Any]]) -> None:
    """Print what was refused or failed, and what runs on a joint that it was not trained on."""
    others = {
        (r["agent"], r["cell"]["joint"], r["cell"]["structure"]): r
        for r in results
        if r["status"] != "done"
    }
    if all(r["status"] != "done" for r in results):
        raise ConfigurationError(str(results[0]["why"]))
    for (agent, joint, structure), result in others.items():
        sys.stderr.write(f"{agent} on {joint}, {structure}: {result['status']}. {result['why']}\n")
    homes = {r["agent"]: r["trained_on"] for r in results if r.get("trained_on")}
    for agent, joint, structure in dict.fromkeys(
        (r["agent"], r["cell"]["joint"], r["cell"]["structure"]) for r in results
    ):
        home = homes.get(agent, (joint, structure))
        if home[1] != structure or not _is_same_joint(home[0], joint):
            where = ", ".join(home)
            sys.stderr.write(f"{agent} was trained on {where}, and runs on {joint}, {structure}.\n")


def _is_same_joint(one: str, other: str) -> bool:
    """Return whether two names or files are of the same joint; not where one cannot be read."""
    try:
        return one == other or load_joint_file(one).hash_hex() == load_joint_file(other).hash_hex()
    except CjtGymError:
        return False


def _facts(options: argparse.Namespace, results: list[dict[str, Any]]) -> list[str]:
    from cjt_gym.training.benchmark.results import effects_in_force

    seeds = f"seed {options.seed}" if options.seeds == 1 else f"{options.seeds} seeds"
    done = [r for r in results if r["status"] == "done"]
    places = list(dict.fromkeys((r["cell"]["joint"], r["cell"]["structure"]) for r in done))
    joints, structures = (list(dict.fromkeys(names)) for names in zip(*places, strict=True))
    counts = [counted(len(joints), "joint"), counted(len(structures), "structure")]
    agents = len({r["agent"] for r in done})
    return [
        f"{agents} controllers and policies, {', '.join(counts)}, {options.episodes} episodes of "
        f"each task and seed, {seeds}. All meet the same joints, references and noise. Every "
        "episode draws its own parameters, from seeds that neither training nor tuning uses. "
        f"cjt-gym {__version__}.",
        *(f"{joint}, {s}. {effects_in_force(results, joint, s)}." for joint, s in places),
    ]
