"""`python -m experiments.results`: train, compare, and write what came out."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.errors import CjtGymError
from cjt_gym.training.benchmark import align
from experiments.marks import read_results
from experiments.results import tables
from experiments.results.experiment import run_results
from experiments.results.page import write_all, write_document, write_page
from experiments.results.plan import STRUCTURES, Plan


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison, write `results.json` and `report.html`, and print its tables."""
    parser = argparse.ArgumentParser(
        prog="python -m experiments.results",
        description="Compare learned with classical controllers.",
    )
    add, usual = parser.add_argument, Plan(Path("results"))
    add(
        "--out",
        type=Path,
        default=usual.out,
        help="folder; work that is already in it is not repeated",
    )
    add("--joint", default=usual.joint)
    add(
        "--recipe",
        default=usual.recipe,
        help="configuration of the training, for all structures instead of one for each",
    )
    add(
        "--structure", choices=STRUCTURES, action="append", help="of the joint; usually all of them"
    )
    add("--seeds", type=int, default=usual.seeds, help="trainings of each structure")
    add("--steps", type=int, help="of a training, instead of the recipe's")
    add("--episodes", type=int, default=usual.episodes, help="of each task")
    add("--jobs", type=int, default=usual.jobs, help="processes")
    add(
        "--document",
        type=Path,
        help="Markdown document whose tables, between marks with the name of --out, are rewritten",
    )
    add("--write-only", action="store_true", help="run nothing: take results.json of --out")
    values = vars(parser.parse_args(arguments))
    document, write_only = values.pop("document"), values.pop("write_only")
    structures = tuple(values.pop("structure") or usual.structures)
    plan, begun = Plan(structures=structures, **values), time.monotonic()
    try:
        if write_only:
            page = write_page(plan.out, read_results(plan.out, "results")["structures"])
        else:
            page = write_all(plan, run_results(plan, _say))
        data = read_results(plan.out, "results")
        if document is not None:
            write_document(document, data, plan.out.name)
    except CjtGymError as error:
        sys.stderr.write(f"results: {error}\n")
        return 2
    for one in data["structures"]:
        words = "\n".join([tables.sentence(one), *tables.verdicts(one)])
        parts = [align(table(one)) for table in tables.PARTS.values()]
        sys.stdout.write("\n\n".join([words, *parts]) + "\n\n")
    sys.stdout.write(f"{page}: {time.monotonic() - begun:.0f} s\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
