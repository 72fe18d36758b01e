"""Writes the table of controllers into docs/controllers.md: `python -m tools.controllers_page`.

With `--check` it writes nothing and fails where the page is not what the table says.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.baselines import CONTROLLERS, ControllerEntry
from cjt_gym.baselines.entry import EVERY, FIXED, SPRUNG

PAGE = Path(__file__).parents[1] / "docs" / "controllers.md"
BEGIN = "<!-- table of controllers: python -m tools.controllers_page -->\n"
END = "<!-- end -->"
HOLDS = {EVERY: "all five", SPRUNG: "free, fixed", FIXED: "fixed"}


def row(entry: ControllerEntry) -> str:
    """Return the line of one controller."""
    gains = ", ".join(
        f"`{gain.name}`" + (f" [{gain.unit}]" if gain.unit != "-" else "") for gain in entry.tunable
    )
    holds = HOLDS[entry.structures]
    return f"| `{entry.name}` | {entry.summary} | {gains} | {holds} | {entry.source} |"


def page(text: str) -> str:
    """Return the page with the table as it is now."""
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    head = "| name | law | gains | holds for | source |\n|---|---|---|---|---|\n"
    return before + BEGIN + head + "\n".join(map(row, CONTROLLERS.values())) + "\n" + END + after


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
