"""Writes the tables of docs/controllers.md: `python -m tools.controllers_page`.

With `--check` it writes nothing and fails where the page is not what the table says.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.baselines import CONTROLLERS, ControllerEntry
from cjt_gym.baselines.entry import EVERY, FIXED, SPRUNG, Gain
from cjt_gym.baselines.parts import PARTS
from tools.written import with_tables, write_or_check

PAGE = Path(__file__).parents[1] / "docs" / "controllers.md"
HOLDS = {EVERY: "all five", SPRUNG: "free, fixed", FIXED: "fixed"}


def row(entry: ControllerEntry) -> str:
    """Return the line of one controller."""
    holds, gains = HOLDS[entry.structures], named(entry.tunable)
    return f"| `{entry.name}` | {entry.summary} | {gains} | {holds} | {entry.source} |"


def named(gains: Sequence[Gain]) -> str:
    """Return gains with their units."""
    return ", ".join(f"`{g.name}`" + (f" [{g.unit}]" if g.unit != "-" else "") for g in gains)


def controllers() -> str:
    """Return the table of controllers."""
    head = ["| name | law | gains | holds for | source |", "|---|---|---|---|---|"]
    return "\n".join([*head, *map(row, CONTROLLERS.values())])


def parts() -> str:
    """Return the table of parts."""
    head = ["| part | kind | what it adds | gains | holds for |", "|---|---|---|---|---|"]
    rows = (
        f"| `{p.name}` | {p.kind} | {p.summary} | {named(p.tunable)} | {HOLDS[p.structures]} |"
        for p in PARTS.values()
    )
    return "\n".join([*head, *rows])


def main(words: Sequence[str] | None = None) -> int:
    """Write the page, or check it."""
    tables = {"table of controllers": controllers(), "table of parts": parts()}
    tool = "tools.controllers_page"
    return write_or_check(tool, PAGE, with_tables(PAGE.read_text("utf-8"), tool, tables), words)


if __name__ == "__main__":
    sys.exit(main())
