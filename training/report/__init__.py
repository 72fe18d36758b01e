"""A self-contained HTML page: text, tables and figures, fit for printing."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from cjt_gym.disk import write_text

STYLE = """
body { font: 16px/1.5 Georgia, 'Times New Roman', serif; color: #202020; max-width: 56rem;
  margin: 3rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; font-weight: normal; margin-bottom: 0.2rem; }
h2 { font-size: 1.2rem; font-weight: normal; margin-top: 2.2rem; border-bottom: 1px solid #bbb; }
p.note, figcaption, td.note { color: #555; font-size: 0.9rem; }
figure { margin: 1rem 0; break-inside: avoid; }
figure svg { width: 100%; height: auto; }
table { border-collapse: collapse; font-size: 0.85rem; margin: 1rem 0; break-inside: avoid; }
th, td { text-align: right; padding: 0.15rem 0.5rem; white-space: nowrap; }
th { font-weight: normal; color: #555; border-bottom: 1px solid #202020; vertical-align: bottom;
  white-space: normal; }
th:first-child, td:first-child, td.text { text-align: left; padding-left: 0; }
td.long { text-align: left; white-space: normal; min-width: 24rem; }
tr.first td { border-top: 1px solid #ddd; }
div.wide { overflow-x: auto; }
@media print { body { margin: 0; max-width: none; font-size: 11pt; } h2 { break-after: avoid; } }
"""


LONG = 60
"""Characters from which the text of a cell is broken into lines."""


def paragraph(text: str, note: bool = False) -> str:
    """Return text as a paragraph."""
    return f"<p{' class=note' if note else ''}>{escape(text)}</p>"


def heading(text: str) -> str:
    """Return the heading of a section."""
    return f"<h2>{escape(text)}</h2>"


def figure(svg: str, caption: str) -> str:
    """Return a figure with its caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def code(text: str) -> str:
    """Return text as it is, with its lines."""
    return f"<pre>{escape(text)}</pre>"


def html_table(cells: Sequence[Sequence[str]]) -> str:
    """Return a table whose first line is its head; a line begins a group where column 1 changes."""
    lines = ["".join(f"<th>{escape(cell)}</th>" for cell in cells[0])]
    group = None
    for line in cells[1:]:
        new = " class=first" if line[0] != group else ""
        group = line[0]
        lines.append(f"<tr{new}>" + "".join(map(_cell, line)) + "</tr>")
    return f"<div class=wide><table><tr>{lines[0]}</tr>{''.join(lines[1:])}</table></div>"


def _cell(text: str) -> str:
    long = " class=long" if len(text) > LONG else ""
    return f"<td{long}>{escape(text)}</td>"


def write_page(path: Path, title: str, parts: Sequence[str]) -> Path:
    """Write a page and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = (
        f"<!doctype html><html lang=en><head><meta charset=utf-8><title>{escape(title)}</title>"
        "<meta name=viewport content='width=device-width'>"
        f"<style>{STYLE}</style></head><body><h1>{escape(title)}</h1>{''.join(parts)}</body></html>"
    )
    write_text(path, text)
    return path
