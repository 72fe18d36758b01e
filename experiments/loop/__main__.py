"""`python -m experiments.loop`: run the experiment and write its report."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.errors import CjtGymError
from experiments.loop.experiment import Plan, run_experiment
from experiments.loop.joints import GROUPS
from experiments.loop.report import (
    read_outcomes,
    summary_of,
    verdict,
    write_document,
    write_page,
    write_results,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run, write `loop.json` and `report.html`, and print what came out."""
    text = "Train policies, run them on joints that hide effects, diagnose, train on, compare."
    parser = argparse.ArgumentParser(description=text)
    add, usual = parser.add_argument, Plan(Path("loop"))
    add("--out", type=Path, default=usual.out, help="folder; what is in it is not done again")
    add("--groups", type=int, default=usual.groups, choices=range(1, len(GROUPS) + 1))
    add("--per-group", type=int, default=usual.per_group, help="joints of each datasheet")
    add("--steps", type=int, default=usual.steps, help="of the training on a datasheet")
    add("--more", type=int, default=usual.more, help="of what goes on from it on a joint")
    add("--seed", type=int, default=usual.seed)
    add("--jobs", type=int, default=usual.jobs, help="processes")
    add("--document", type=Path, help="Markdown document that gets the tables between its marks")
    add("--write-only", action="store_true", help="run nothing: take loop.json of --out")
    values = vars(parser.parse_args(arguments))
    document, write_only = values.pop("document"), values.pop("write_only")
    plan, begun = Plan(**values), time.monotonic()
    try:
        if not write_only:
            outcomes = run_experiment(plan, _say)
            write_results(outcomes, plan, time.monotonic() - begun)
        data = read_outcomes(plan.out)
        page = write_page(plan.out, data["joints"])
        if document is not None:
            write_document(document, data)
    except CjtGymError as error:
        sys.stderr.write(f"loop: {error}\n")
        return 2
    sys.stdout.write(f"{verdict(summary_of(data['joints']))}\n\n{page}\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
