"""`cjt-gym runs`: list and compare training runs, and write the page of one."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Mapping

from cjt_gym.console import Answer
from cjt_gym.training.benchmark import align, in_columns
from cjt_gym.training.learning.runs import COLUMNS, compared, find_runs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where to look and what to write."""
    add = parser.add_argument
    text = "run folders, or folders that contain runs; default: runs"
    add("folders", nargs="*", default=["runs"], metavar="FOLDER", help=text)
    add("--page", action="store_true", help="write page.html into every listed run")


WIDTH, LONGEST = 100, 60
"""Width of a line, and greatest length of a value, which --json has in full."""


def run(options: argparse.Namespace) -> Answer:
    """List the runs; write their pages."""
    found = find_runs(options.folders)
    rows = compared(found)
    if options.page:
        from cjt_gym.training.learning.run_page import write_run_page

        pages = {str(one.path): str(write_run_page(one)) for one in found}
        for row in rows:
            row["page"] = pages[row["run"]]
    lines = [align(in_columns(rows, COLUMNS))]
    for row in rows:
        if row["differs"]:
            said = f"{row['run']} differs from the first in {_changes(row['differs'])}"
            lines += textwrap.wrap(said, WIDTH, subsequent_indent="  ")
        if options.page:
            lines.append(row["page"])
    return rows, "\n".join(lines)


def _changes(differs: Mapping[str, object]) -> str:
    """Return options with their values, those that are long cut short."""
    said = ((name, str(value)) for name, value in differs.items())
    return ", ".join(
        f"{name} = {text if len(text) <= LONGEST else f'{text[:LONGEST]} …'}" for name, text in said
    )
