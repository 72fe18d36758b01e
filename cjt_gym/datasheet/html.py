"""A sheet as one self-contained HTML page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from importlib import resources

from cjt_gym.datasheet.blocks import Block, Code, Facts, Figure, Heading, Paragraph, Sheet, Table
from cjt_gym.datasheet.notation import render, without_formulas


def to_html(sheet: Sheet) -> str:
    """Return the text of the page; it needs no other file and no network."""
    style = (resources.files("cjt_gym.datasheet") / "style.css").read_text(encoding="utf-8")
    body = "\n".join(_blocks(sheet))
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(without_formulas(sheet.title))}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        f"<header><h1>{_text(sheet.title)}</h1>\n<p>{_text(sheet.subtitle)}</p></header>\n"
        f"{body}\n<footer>{_text(sheet.footer)}</footer>\n</main>\n</body>\n</html>\n"
    )


def _text(text: str) -> str:
    return render(text, escape, lambda x: f"<i>{x}</i>", lambda x: f"<sub>{x}</sub>")


def _blocks(sheet: Sheet) -> Iterator[str]:
    for half, row in sheet.rows():
        if half:
            figures = (_figure(block, k) for k, block in row if isinstance(block, Figure))
            yield f'<div class="figures">{"".join(figures)}</div>'
        else:
            yield from (_block(block, k) for k, block in row)


def _block(block: Block, number: int) -> str:
    match block:
        case Heading(text):
            return f"<h2>{_text(text)}</h2>"
        case Paragraph(text, small):
            return f'<p class="small">{_text(text)}</p>' if small else f"<p>{_text(text)}</p>"
        case Facts(items):
            cells = (
                f"<div><b>{_text(value)}</b> {_text(unit)}<span>{_text(name)}</span></div>"
                for name, value, unit in items
            )
            return f'<div class="facts">{"".join(cells)}</div>'
        case Table():
            return _table(block)
        case Figure():
            return f'<div class="figures whole">{_figure(block, number)}</div>'
        case Code(text):
            return f"<pre>{escape(text)}</pre>"
        case _:
            return ""


def _table(table: Table) -> str:
    def row(cells: list[str] | tuple[str, ...], tag: str) -> str:
        if len(cells) == 1:
            return f'<tr class="group"><th colspan="{len(table.head)}">{_text(cells[0])}</th></tr>'
        return (
            "<tr>"
            + "".join(
                f'<{tag} class="{side}">{_text(cell)}</{tag}>'
                for cell, side in zip(cells, table.align, strict=True)
            )
            + "</tr>"
        )

    head = row(list(table.head), "th")
    lines = "\n".join(row(list(cells), "td") for cells in table.rows)
    return f'<div class="scroll"><table><thead>{head}</thead>\n<tbody>{lines}</tbody></table></div>'


def _figure(figure: Figure, number: int) -> str:
    """Return a figure whose names of parts are unique on the page."""
    svg = re.sub(r'(id="|xlink:href="#|href="#|url\(#)', rf"\g<1>f{number}-", figure.svg)
    return f"<figure>{svg}<figcaption>{_text(figure.caption)}</figcaption></figure>"
