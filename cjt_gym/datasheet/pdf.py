"""A sheet as PDF, typeset by Typst, a Python package without further dependencies."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from cjt_gym.datasheet.blocks import (
    Block,
    Code,
    Facts,
    Figure,
    Heading,
    PageBreak,
    Paragraph,
    Sheet,
    Table,
)
from cjt_gym.datasheet.notation import render, without_formulas

ACCENT = "#1f5fa8"
PREAMBLE = """
#set page(paper: "a4", margin: (x: 17mm, top: 15mm, bottom: 16mm), footer: context [
  #set text(7.5pt, fill: luma(40%))
  FOOTER #h(1fr) #counter(page).display("1 / 1", both: true)
])
#set document(title: TITLE)
#set text(font: "Libertinus Serif", size: 9pt, lang: "en", number-type: "lining",
  number-width: "tabular", fallback: true)
#set par(justify: false, leading: 0.5em, spacing: 0.7em)
#set table(stroke: none, inset: (x: 3.5pt, y: 2.1pt))
#let accent = rgb("ACCENT")
#show heading: it => block(above: 1.1em, below: 0.55em, text(11pt, fill: accent, it.body))
#let small(body) = text(7.8pt, fill: luma(35%), body)
#let fact(name, value, unit) = block(stroke: (left: 2pt + accent), inset: (left: 6pt, y: 2pt))[
  #text(13pt, weight: "semibold", value) #unit \\ #text(7.8pt, fill: luma(35%), name)]
#let part(body, n) = table.cell(colspan: n, inset: (x: 3.5pt, top: 5pt, bottom: 2pt),
  text(weight: "semibold", fill: accent, body))
"""


def to_pdf(sheet: Sheet, *, image: bool = False) -> list[bytes]:
    """Return a sheet as one PDF document, or as one PNG image per page."""
    import typst

    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for number, block in enumerate(sheet.blocks):
            if isinstance(block, Figure):
                (root / f"figure{number}.svg").write_text(block.svg, encoding="utf-8")
        source = root / "sheet.typ"
        source.write_text(to_typst(sheet), encoding="utf-8")
        if image:
            made = typst.compile(str(source), format="png", ppi=100.0)
        else:
            made = typst.compile(str(source), format="pdf")
    pages: object = made  # a list where there are several images
    return pages if isinstance(pages, list) else [made]


def to_typst(sheet: Sheet) -> str:
    """Return a sheet as the source that Typst sets; figures are files figure<k>.svg beside it."""
    given = {"FOOTER": _text(sheet.footer), "ACCENT": ACCENT, "TITLE": _string(sheet.title)}
    preamble = re.sub("FOOTER|ACCENT|TITLE", lambda found: given[found[0]], PREAMBLE)
    title = (
        f'#text(20pt, weight: "semibold")[{_text(sheet.title)}] \\\n'
        f"#small[{_text(sheet.subtitle)}]\n#v(-0.4em)#line(length: 100%, stroke: 1.2pt + accent)\n"
    )
    return preamble + title + "\n".join(_blocks(sheet)) + "\n"


def _escape(text: str) -> str:
    return re.sub(r"([\\#*_`$<>@~\[\]=+/-])", r"\\\1", text)


def _string(text: str) -> str:
    escaped = without_formulas(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _text(text: str) -> str:
    return render(text, _escape, lambda x: f"#emph[{x}];", lambda x: f"#sub[{x}];")


def _blocks(sheet: Sheet) -> Iterator[str]:
    for half, row in sheet.rows():
        if half:
            cells = (f"[{_figure(block, k)}]" for k, block in row if isinstance(block, Figure))
            yield f"#grid(columns: (1fr, 1fr), gutter: 5mm, {', '.join(cells)})"
        else:
            yield from (_block(block, k) for k, block in row)


def _figure(figure: Figure, number: int) -> str:
    return f'#image("figure{number}.svg", width: 100%) #v(-0.4em) #small[{_text(figure.caption)}]'


def _block(block: Block, number: int) -> str:
    match block:
        case Heading(text):
            return f"= {_text(text)}"
        case Paragraph(text, small):
            return f"#small[{_text(text)}]\n" if small else f"{_text(text)}\n"
        case Facts(items):
            cells = ", ".join(
                f"fact([{_text(name)}], [{_text(value)}], [{_text(unit)}])"
                for name, value, unit in items
            )
            return f"#grid(columns: (1fr,) * {min(len(items), 6)}, gutter: 8pt, {cells})"
        case Table():
            return _table(block)
        case Figure():
            return f"#block[{_figure(block, number)}]"
        case Code(text):
            return f"#raw({json.dumps(text, ensure_ascii=False)}, block: true)"
        case PageBreak():
            return "#pagebreak()"


def _table(table: Table) -> str:
    """Return a table, cut into equal parts where it is set in several columns."""
    if table.columns == 1:
        return f"#text(8pt)[{_part(table, table.rows)}]"
    length = -(-len(table.rows) // table.columns)
    parts = [table.rows[k : k + length] for k in range(0, len(table.rows), length)]
    cells = ", ".join(f"[{_part(table, rows)}]" for rows in parts)
    return f"#text(8pt)[#grid(columns: (1fr,) * {table.columns}, gutter: 5mm, {cells})]"


def _part(table: Table, rows: object) -> str:
    assert isinstance(rows, list | tuple)
    width = len(table.head)
    columns = ", ".join("1fr" if k in table.wide else "auto" for k in range(width))
    align = ", ".join("right" if side == "r" else "left" for side in table.align)
    head = ", ".join(f'text(weight: "semibold")[{_text(cell)}]' for cell in table.head)
    lines = []
    for cells in rows:
        if len(cells) == 1:
            lines.append(f"part([{_text(cells[0])}], {width})")
        else:
            lines.append(", ".join(f"[{_text(cell)}]" for cell in cells))
        lines.append("table.hline(stroke: 0.3pt + luma(85%))")
    body = ",\n".join(lines)
    return (
        f"#table(columns: ({columns},), align: ({align},), table.header({head}), "
        f"table.hline(stroke: 0.8pt),\n{body})"
    )
