"""Tables in Markdown, and the section of README.md that holds them."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.marks import fill, markdown

README = Path(__file__).with_name("README.md")
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
        cells = markdown([self.header, *self.rows])
        return f"### {self.title}\n\n{self.note}\n\n{cells}"


def conditions() -> str:
    """Return the machine in words and the versions that ran."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in VERSIONED)
    return (
        f"Measured on {os.cpu_count()} cores with Python {platform.python_version()}, {versions}."
    )


def write(tables: Sequence[Table]) -> None:
    """Replace what stands between the marks of README.md."""
    body = "\n\n".join([conditions(), *(table.markdown() for table in tables)])
    fill(README, "benchmarks", {"results": body})
