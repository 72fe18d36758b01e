"""Writes docs/features.md out of the table of features: python -m tools.features [--check]."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from tools.features.table import FEATURES, Feature
from tools.written import write_or_check

PAGE = Path(__file__).resolve().parents[2] / "docs" / "features.md"
HEAD = """# Features of the toolbox, and how to use them here

Every command below is run by a test. Python lines need `from cjt_gym import load_joint` before
them. The files `example_params.m`, `table.toml`, `mylaw.py` and `joint.toml` stand for your own: a
[parameter file](joint_files.md#joints-of-the-toolbox) of the toolbox, a [table of
joints](datasheet.md#many-joints-from-one-table), a [controller](controllers.md#bring-your-own) and
a [joint on a bus](hardware.md). [Differences](differences.md) lists where results differ.

<!-- Written by `python -m tools.features`; change tools/features/table.py instead. -->
"""


def page() -> str:
    """Return the page."""
    parts = [HEAD]
    for group, rows in groupby(FEATURES, lambda row: row.group):
        parts.append(f"\n## {group}\n\n| in the toolbox | here | |\n|---|---|---|\n")
        parts += [_line(row) for row in rows]
    return "".join(parts)


def _line(row: Feature) -> str:
    here = f"`{row.command}`" if row.command else "-"
    return f"| {row.what} | {here} | {row.note} |\n"


def main(words: Sequence[str] | None = None) -> int:
    """Write or check the page; return the exit status."""
    return write_or_check("tools.features", PAGE, page(), words)


if __name__ == "__main__":
    sys.exit(main())
