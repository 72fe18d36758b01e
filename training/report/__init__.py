"""Pages of trainings and benchmarks, made of the blocks of a sheet from plain text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from cjt_gym.datasheet.blocks import Block, Figure, Heading, Paragraph, Sheet, Table
from cjt_gym.datasheet.html import to_html
from cjt_gym.datasheet.notation import plain
from cjt_gym.disk import write_text

NUMBER = re.compile(r"[-+]?\d|-?inf$|-$")
"""What the cell of a number begins with; one that is not known is a dash."""
LONG = 30
"""Characters of a cell from which it is text, however it begins."""


def paragraph(text: str, note: bool = False) -> Paragraph:
    """Return text as a paragraph."""
    return Paragraph(plain(text), small=note)


def heading(text: str) -> Heading:
    """Return the heading of a section."""
    return Heading(plain(text))


def figure(svg: str, caption: str) -> Figure:
    """Return a figure with its caption."""
    return Figure(svg, plain(caption), whole=True)


def html_table(cells: Sequence[Sequence[str]]) -> Table:
    """Return a table whose first line is its head; columns of numbers stand to the right."""
    head, *rows = [[plain(cell) for cell in line] for line in cells]
    return Table(head, rows, "".join(_side([row[k] for row in rows]) for k in range(len(head))))


def _side(cells: Sequence[str]) -> str:
    numbers = sum(bool(NUMBER.match(cell)) for cell in cells)
    return "r" if 2 * numbers > len(cells) and max(map(len, cells)) < LONG else "l"


def write_page(path: Path, title: str, parts: Sequence[Block]) -> Path:
    """Write a page and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, to_html(Sheet(plain(title), "", parts)))
    return path
