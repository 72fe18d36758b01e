"""Writes the tables of docs/characteristics.md: `python -m tools.characteristics_page`.

With `--check` it writes nothing and fails where the page is not what the tables say.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from cjt_gym.characteristics import CHARACTERISTICS
from tools.characteristics_comparison import ROWS, secondary_differences
from tools.written import with_tables, write_or_check

PAGE = Path(__file__).parents[1] / "docs" / "characteristics.md"
LEAST = 1e-12


def quantities() -> Iterator[str]:
    """Yield the lines of the table of quantities."""
    yield "| name | what | unit | formula |"
    yield "|---|---|---|---|"
    for row in CHARACTERISTICS.values():
        yield f"| `{row.name}` | {row.title} {row.symbol} | {row.unit()} | {row.formula} |"


def comparison() -> Iterator[str]:
    """Yield the lines of the table of comparisons."""
    yield "| quantity | largest difference | why |"
    yield "|---|---|---|"
    names, differences = zip(*secondary_differences(), strict=True)
    listed = ", ".join(f"`{name}`" for name in names)
    yield f"| {listed} (nine sets) | {bound(max(differences))} | |"
    for row in ROWS:
        largest = row.largest()
        if row.change == "factor":
            shown = f"factor {largest:.2g}" if largest < 100.0 else f"factor {largest:.0f}"
        else:
            shown = f"{100.0 * largest:.2g} %" if row.reason else bound(largest)
        yield f"| {row.name} | {shown} | {row.reason} |"


def bound(difference: float) -> str:
    """Return the power of ten that a difference lies below."""
    power = math.ceil(math.log10(max(difference, 0.5 * LEAST)))
    return f"< 1e{power:d}"


def main(words: Sequence[str] | None = None) -> int:
    """Write the page, or check it."""
    tables = {"quantities": "\n".join(quantities()), "comparison": "\n".join(comparison())}
    tool = "tools.characteristics_page"
    return write_or_check(tool, PAGE, with_tables(PAGE.read_text("utf-8"), tool, tables), words)


if __name__ == "__main__":
    sys.exit(main())
