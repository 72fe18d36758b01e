"""Tables in Markdown, and the section of README.md that holds them."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

README = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- results -->", "<!-- end of results -->"
VERSIONED = ("cjt-gym", "numpy", "scipy", "numba", "gymnasium")


@dataclass(frozen=True)
class Table:
    """One table of results.

    Attributes:
        title: Its heading.
        note: What was measured and how, in a sentence or two.
        header: Names of the columns.
        rows: Cells as text.
    """

    title: str
    note: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return the table with its heading and note."""
        lines = [self.header, ["---"] * len(self.header), *self.rows]
        cells = ["| " + " | ".join(line) + " |" for line in lines]
        return "\n".join([f"### {self.title}", "", self.note, "", *cells])


def conditions() -> str:
    """Return the machine in words and the versions that ran."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in VERSIONED)
    return (
        f"Measured on {os.cpu_count()} cores with Python {platform.python_version()}, {versions}."
    )


def write(tables: Sequence[Table]) -> None:
    """Replace what stands between the two marks of README.md."""
    text = README.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    body = "\n\n".join([conditions(), *(table.markdown() for table in tables)])
    README.write_text(f"{before}{BEGIN}\n\n{body}\n\n{END}{after}", encoding="utf-8")
