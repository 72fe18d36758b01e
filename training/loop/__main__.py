"""`python -m cjt_gym.training.loop`: run the experiment and write its report."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.errors import CjtGymError
from cjt_gym.training.loop.experiment import Plan, run_experiment
from cjt_gym.training.loop.joints import GROUPS
from cjt_gym.training.loop.report import summary_of, verdict, write_report


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
    plan = Plan(**vars(parser.parse_args(arguments)))
    begun = time.monotonic()
    try:
        outcomes = run_experiment(plan, _say)
    except CjtGymError as error:
        sys.stderr.write(f"loop: {error}\n")
        return 2
    page = write_report(outcomes, plan, time.monotonic() - begun)
    sys.stdout.write(f"{verdict(summary_of(outcomes))}\n\n{page}\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
