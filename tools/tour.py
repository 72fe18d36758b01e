"""The tour as notebooks: percent scripts that are run, with what they print and draw.

`python tools/tour.py` runs examples/tour/NAME.py and writes examples/tour/NAME.ipynb beside it;
names as arguments choose some of them. The site shows these notebooks as pages.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jupytext
import nbformat

TOUR = Path(__file__).resolve().parent.parent / "examples/tour"
SETTINGS = {"font.size": 9.0, "axes.grid": True, "grid.alpha": 0.3}
DPI = 100
IMAGE = "image/png"
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


@dataclass(frozen=True)
class Page:
    """One notebook of the tour as a page.

    Attributes:
        name: Name of the script without its suffix.
        title: Its heading.
        opening: Its first sentence.
        markdown: Text, code and outputs; pictures are named NAME-k.png.
        pictures: PNG files by that name.
    """

    name: str
    title: str
    opening: str
    markdown: str
    pictures: dict[str, bytes]


def scripts() -> list[Path]:
    """Return the scripts of the tour in their order."""
    return sorted(TOUR.glob("[0-9]*.py"))


def cells_of(path: Path) -> Any:
    """Return a script as a notebook that has not been run."""
    notebook = jupytext.read(path, fmt="py:percent")
    notebook.metadata = nbformat.from_dict(KERNEL)
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"{path.stem}-{number}"
        cell["metadata"] = {}
    return notebook


def run(path: Path) -> Any:
    """Run a script cell by cell, in a folder of its own, and return it as a notebook."""
    import matplotlib
    from matplotlib import pyplot

    notebook = cells_of(path)
    scope: dict[str, Any] = {"__name__": path.stem}
    before, count = os.getcwd(), 0
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context(SETTINGS):
        pyplot.switch_backend("agg")
        pyplot.close("all")  # figures that others left open are none of this notebook's
        os.chdir(folder)
        try:
            for number, cell in enumerate(notebook.cells):
                if cell.cell_type == "code":
                    cell["execution_count"] = count = count + 1
                    name = f"{path.name}[{number}]"
                    cell["outputs"] = list(_outputs(cell.source, name, scope, count))
        finally:
            os.chdir(before)
            pyplot.close("all")
    return notebook


def page_of(path: Path) -> Page:
    """Return a notebook with its outputs as a page."""
    notebook = nbformat.read(path, as_version=4)
    pictures: dict[str, bytes] = {}
    text = "\n\n".join(_parts(path.stem, notebook, pictures)) + "\n"
    begin = re.match(r"# ([^\n]+)\n\n(.+?\.)\s", text, re.DOTALL)
    assert begin, f"{path.name} must begin with a heading and a sentence"
    return Page(path.stem, begin[1], begin[2].replace("\n", " "), text, pictures)


def _outputs(source: str, name: str, scope: dict[str, Any], count: int) -> Iterator[Any]:
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
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
        picture = base64.b64encode(buffer.getvalue()).decode()
        yield new("display_data", data={IMAGE: picture, "text/plain": repr(figure)})
    pyplot.close("all")
    if value is not None and not figures:
        yield new("execute_result", data=_faces(value), execution_count=count)


def _faces(value: Any) -> dict[str, str]:
    """Return how a notebook shows a value: as text, and as HTML or LaTeX where it can."""
    found = {"text/plain": repr(value)}
    for kind, method in (("text/html", "_repr_html_"), ("text/latex", "_repr_latex_")):
        face = getattr(value, method, lambda: None)()
        if face:
            found[kind] = face
    return found


def _parts(name: str, notebook: Any, pictures: dict[str, bytes]) -> Iterator[str]:
    """Yield cells and outputs as Markdown; collect the pictures."""
    for cell in notebook.cells:
        if cell.cell_type != "code":
            yield cell.source
            continue
        yield f"```python\n{cell.source}\n```"
        for output in cell.outputs:
            data = output.get("data", {})
            if IMAGE in data:
                picture = f"{name}-{len(pictures) + 1}.png"
                pictures[picture] = base64.b64decode(data[IMAGE])
                yield f"![]({picture})"
            elif "text/latex" in data:
                yield f"$$\n{data['text/latex'].strip('$ ')}\n$$"
            elif "text/html" in data:
                yield f'<div class="output">{data["text/html"]}</div>'
            else:
                text = output.get("text") or data["text/plain"]
                yield f"```text\n{text.rstrip()}\n```"


def main(names: Sequence[str]) -> int:
    """Write the notebooks of scripts; return the exit status."""
    chosen = [path for path in scripts() if not names or path.stem in names]
    for path in chosen:
        made = path.with_suffix(".ipynb")
        made.write_text(nbformat.writes(run(path)) + "\n", encoding="utf-8")
        print(f"{made.relative_to(TOUR.parent.parent)}: {made.stat().st_size / 1e3:.0f} kB")
    return 0 if chosen else 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
