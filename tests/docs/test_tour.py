"""The tour runs from its first cell to its last; the quick parts in every test, all of it slow."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("jupytext")
pytest.importorskip("matplotlib")
nbformat = pytest.importorskip("nbformat")

ROOT = Path(__file__).parents[2]
TOUR = sorted((ROOT / "examples/tour").glob("[0-9]*.py"))
SLOW = {"04_datasheet", "06_controllers", "07_compare", "08_train", "10_diagnose", "11_article"}


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=[pytest.mark.slow] if p.stem in SLOW else [], id=p.stem) for p in TOUR],
)
def test_a_part_of_the_tour_runs(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    tour = pytest.importorskip("tour")
    page = tour.run(path)
    assert page.markdown.startswith(f"# {page.title}\n")
    assert re.search(r"^(```text|!\[\])", page.markdown, re.MULTILINE)
    assert all(f"![]({name})" in page.markdown for name in page.pictures)
    notebook = nbformat.reads(page.notebook, as_version=4)
    nbformat.validate(notebook)
    assert any(cell.cell_type == "code" and cell.outputs for cell in notebook.cells)


def test_the_page_of_examples_lists_every_part() -> None:
    text = (ROOT / "docs/examples.md").read_text("utf-8")
    assert re.findall(r"^\| \[(\d\d_\w+\.py)\]", text, re.MULTILINE) == [p.name for p in TOUR]
