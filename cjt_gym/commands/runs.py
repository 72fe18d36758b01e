"""`cjt-gym runs`: list and compare training runs, and write the page of one."""

from __future__ import annotations

import argparse

from cjt_gym.console import Answer
from cjt_gym.training.benchmark import align, in_columns
from cjt_gym.training.learning.runs import COLUMNS, compared, find_runs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where to look and what to write."""
    add = parser.add_argument
    text = "run folders, or folders that contain runs; default: runs"
    add("folders", nargs="*", default=["runs"], metavar="FOLDER", help=text)
    add("--page", action="store_true", help="write page.html into every listed run")


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
            changes = ", ".join(f"{name} = {value}" for name, value in row["differs"].items())
            lines.append(f"{row['run']} differs from the first in {changes}")
        if options.page:
            lines.append(row["page"])
    return rows, "\n".join(lines)
