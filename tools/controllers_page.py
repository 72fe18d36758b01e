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

PAGE = Path(__file__).parents[1] / "docs" / "controllers.md"
BEGIN = "<!-- table of controllers: python -m tools.controllers_page -->\n"
END = "<!-- end -->"
PARTS_BEGIN = "<!-- table of parts: python -m tools.controllers_page -->\n"
PARTS_END = "<!-- end of parts -->"
HOLDS = {EVERY: "all five", SPRUNG: "free, fixed", FIXED: "fixed"}


def row(entry: ControllerEntry) -> str:
    """Return the line of one controller."""
    holds, gains = HOLDS[entry.structures], named(entry.tunable)
    return f"| `{entry.name}` | {entry.summary} | {gains} | {holds} | {entry.source} |"


def named(gains: Sequence[Gain]) -> str:
    """Return gains with their units."""
    return ", ".join(f"`{g.name}`" + (f" [{g.unit}]" if g.unit != "-" else "") for g in gains)


def parts() -> str:
    """Return the table of parts."""
    head = "| part | kind | what it adds | gains | holds for |\n|---|---|---|---|---|\n"
    rows = (
        f"| `{p.name}` | {p.kind} | {p.summary} | {named(p.tunable)} | {HOLDS[p.structures]} |\n"
        for p in PARTS.values()
    )
    return head + "".join(rows)


def page(text: str) -> str:
    """Return the page with the table as it is now."""
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    head = "| name | law | gains | holds for | source |\n|---|---|---|---|---|\n"
    table = head + "\n".join(map(row, CONTROLLERS.values())) + "\n"
    middle, rest = after.split(PARTS_BEGIN)
    after = middle + PARTS_BEGIN + parts() + PARTS_END + rest.split(PARTS_END)[1]
    return before + BEGIN + table + END + after


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, or check it."""
    old = PAGE.read_text(encoding="utf-8")
    new = page(old)
    if "--check" in (sys.argv[1:] if arguments is None else arguments):
        if old != new:
            sys.stderr.write(f"{PAGE.name} is not what the table says. Run this without --check.\n")
        return int(old != new)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
