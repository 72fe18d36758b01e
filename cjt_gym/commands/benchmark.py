"""`cjt-gym benchmark`: controllers and policies on the same joint, tasks and seeds."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.joint import STRUCTURES
from cjt_gym.training.benchmark import benchmark, make_agents, rows_of, table, write_results
from cjt_gym.training.conditions import TASKS, realistic_conditions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to compare, on what, and where to write it."""
    add = parser.add_argument
    add("--joint", required=True, help="name of a joint, or path of a joint file")
    add("--structure", default="output_fixed_rigid_gearbox", help=", ".join(STRUCTURES))
    add("--controller", nargs="+", default=[], metavar="C", help=", ".join(CONTROLLERS))
    add("--policy", nargs="+", default=[], metavar="RUN", help="run folders")
    add("--task", nargs="+", default=list(TASKS), metavar="T", help=", ".join(TASKS))
    add("--amplitude", type=float, help="of the references [N m]; default: from the peak torque")
    add("--episodes", type=int, default=32, help="per task, default 32")
    add("--seed", type=int, default=0, help="of the episodes, default 0")
    add("--out", type=Path, required=True, metavar="DIR", help="folder for the results")


def run(options: argparse.Namespace) -> None:
    """Compare, write `benchmark.json` and `benchmark.txt`, print the table."""
    agents = make_agents(options.controller, options.policy)
    conditions = realistic_conditions(
        options.joint, options.structure, torque_amplitude=options.amplitude
    )
    evaluations = benchmark(
        agents, conditions, options.task, options.episodes, options.seed, _progress
    )
    write_results(evaluations, options.out)
    rows = [row.to_json() for row in rows_of(evaluations)]
    sys.stdout.write((json.dumps(rows, indent=1) if options.json else table(rows)) + "\n")


def _progress(text: str) -> None:
    sys.stderr.write(text + "\n")
