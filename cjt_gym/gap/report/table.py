"""A small table of a report, for the page and for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Table:
    """A table with explanations.

    Attributes:
        title: What it shows.
        aid: How it is read.
        rows: Its cells; the first row is the head.
        notes: Further remarks, one line each.
    """

    title: str
    aid: str
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def html(self) -> str:
        """Return the table for the page, without its title."""
        head, *body = self.rows
        cells = "".join(f"<th>{escape(name)}</th>" for name in head)
        rows = "".join(
            "<tr>"
            + "".join(
                f"<td data-head='{escape(name, quote=True)}'>{escape(cell)}</td>"
                for name, cell in zip(head, row, strict=True)
            )
            + "</tr>"
            for row in body
        )
        notes = "".join(f"<p>{escape(note)}</p>" for note in self.notes)
        return (
            f"<p class=aid>{escape(self.aid)}</p><div class=wide><table><thead><tr>{cells}</tr>"
            f"</thead><tbody>{rows}</tbody></table></div>{notes}"
        )

    def text(self, width: int) -> str:
        """Return the table for a terminal of a given width, with aligned columns."""
        columns = zip(*self.rows, strict=True)
        widths = [max(len(cell) for cell in column) for column in columns]
        lines = [
            "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip()
            for row in self.rows
        ]
        notes = [line for note in self.notes for line in textwrap.wrap(note, width)]
        return "\n".join([self.title, *lines, *notes])
