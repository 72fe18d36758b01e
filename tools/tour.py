"""The tour as pages and notebooks: percent scripts that are run, with what they print and draw.

`run` executes the cells of examples/tour/NAME.py in one namespace, in a folder of their own, as a
notebook would: what a cell prints, the value of its last line and its figures are its outputs.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jupytext
import nbformat

TOUR = Path(__file__).resolve().parent.parent / "examples/tour"
SETTINGS = {"svg.hashsalt": "cjt-gym", "font.size": 9.0, "axes.grid": True, "grid.alpha": 0.3}
IMAGE = "image/svg+xml"


@dataclass(frozen=True)
class Page:
    """One part of the tour, run.

    Attributes:
        name: Name of the script without its ending.
        title: Its heading.
        opening: Its first sentence.
        markdown: Text, code and outputs; pictures are named NAME-k.svg.
        pictures: SVG texts by that name.
        notebook: The same as a notebook with outputs, JSON.
    """

    name: str
    title: str
    opening: str
    markdown: str
    pictures: dict[str, str]
    notebook: str


def scripts() -> list[Path]:
    """Return the parts of the tour in their order."""
    return sorted(TOUR.glob("[0-9]*.py"))


def run(path: Path) -> Page:
    """Run one part of the tour."""
    import matplotlib
    from matplotlib import pyplot

    notebook = jupytext.read(path, fmt="py:percent")
    scope: dict[str, Any] = {"__name__": path.stem}
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context(SETTINGS):
        pyplot.switch_backend("agg")
        os.chdir(folder)
        try:
            for number, cell in enumerate(notebook.cells):
                cell["id"] = f"{path.stem}-{number}"
                if cell.cell_type == "code":
                    cell["outputs"] = list(_outputs(cell.source, f"{path.name}[{number}]", scope))
        finally:
            os.chdir(before)
            pyplot.close("all")
    pictures: dict[str, str] = {}
    text = "\n\n".join(_parts(path.stem, notebook, pictures)) + "\n"
    begin = re.match(r"# ([^\n]+)\n\n(.+?\.)\s", text, re.DOTALL)
    assert begin, f"{path.name} must begin with a heading and a sentence"
    title, opening = begin[1], begin[2].replace("\n", " ")
    return Page(path.stem, title, opening, text, pictures, nbformat.writes(notebook))


def _outputs(source: str, name: str, scope: dict[str, Any]) -> Iterator[Any]:
    """Execute a cell and yield its outputs."""
    from matplotlib import pyplot

    tree, said, value = ast.parse(source), io.StringIO(), None
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, name, "exec"), scope)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), name, "eval"), scope)
    new = nbformat.v4.new_output
    if said.getvalue():
        yield new("stream", name="stdout", text=said.getvalue())
    figures = [pyplot.figure(number) for number in pyplot.get_fignums()]
    for figure in figures:
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
        yield new("display_data", data={IMAGE: buffer.getvalue()})
    pyplot.close("all")
    if value is not None and not figures:
        yield new("execute_result", data=_faces(value), execution_count=None)


def _faces(value: Any) -> dict[str, str]:
    """Return how a notebook shows a value: as text, and as HTML or LaTeX where it can."""
    found = {"text/plain": repr(value)}
    for kind, method in (("text/html", "_repr_html_"), ("text/latex", "_repr_latex_")):
        face = getattr(value, method, lambda: None)()
        if face:
            found[kind] = face
    return found


def _parts(name: str, notebook: Any, pictures: dict[str, str]) -> Iterator[str]:
    """Yield the cells and outputs as Markdown; add pictures to those that there are."""
    for cell in notebook.cells:
        if cell.cell_type != "code":
            yield cell.source
            continue
        yield f"```python\n{cell.source}\n```"
        for output in cell.outputs:
            data = output.get("data", {})
            if IMAGE in data:
                picture = f"{name}-{len(pictures) + 1}.svg"
                pictures[picture] = data[IMAGE]
                yield f"![]({picture})"
            elif "text/html" in data:
                yield f'<div class="output">{data["text/html"]}</div>'
            else:
                text = output.get("text") or data["text/plain"]
                yield f"```text\n{text.rstrip()}\n```"
