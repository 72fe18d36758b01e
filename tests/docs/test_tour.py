"""The tour runs from its first cell to its last, and its notebooks are those of its scripts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("jupytext")
nbformat = pytest.importorskip("nbformat")

from tools import tour  # noqa: E402

ROOT = Path(__file__).parents[2]

SCRIPTS = pytest.mark.parametrize("path", tour.scripts(), ids=lambda path: path.stem)
SLOW = {"04_datasheet", "06_controllers", "07_compare", "08_train", "10_diagnose", "11_article"}
LARGEST = 300_000
"""Size of a notebook [byte]: they are kept in the repository."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(p, marks=[pytest.mark.slow] if p.stem in SLOW else [], id=p.stem)
        for p in tour.scripts()
    ],
)
def test_a_part_of_the_tour_runs(path: Path, tmp_path: Path) -> None:
    notebook = tour.run(path)
    nbformat.validate(notebook)
    made = tmp_path / f"{path.stem}.ipynb"
    made.write_text(nbformat.writes(notebook), encoding="utf-8")
    kept = nbformat.read(path.with_suffix(".ipynb"), as_version=4)
    kinds = [
        [[output.output_type for output in cell.get("outputs", [])] for cell in book.cells]
        for book in (notebook, kept)
    ]
    assert kinds[0] == kinds[1]
    assert tour.page_of(made).title


@SCRIPTS
def test_a_notebook_has_the_cells_of_its_script_and_their_outputs(path: Path) -> None:
    kept = path.with_suffix(".ipynb")
    wanted, found = tour.cells_of(path), nbformat.read(kept, as_version=4)
    nbformat.validate(found)
    again = f"{kept.name} is not {path.name}: make notebooks NOTEBOOKS={path.stem}"
    cells = [[(cell.cell_type, cell.source) for cell in book.cells] for book in (wanted, found)]
    assert cells[0] == cells[1], again
    counts = [cell.execution_count for cell in found.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1)), again
    assert kept.stat().st_size < LARGEST


@SCRIPTS
def test_a_notebook_shows_text_or_pictures_and_its_links_lead_somewhere(path: Path) -> None:
    page = tour.page_of(path.with_suffix(".ipynb"))
    assert page.markdown.startswith(f"# {page.title}\n")
    assert re.search(r"^(```text|!\[\]|\$\$)", page.markdown, re.MULTILINE)
    assert all(f"![]({name})" in page.markdown for name in page.pictures)
    for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.markdown):
        assert link in page.pictures or (path.parent / link).exists(), link


def test_a_legend_says_where_it_stands() -> None:
    """Matplotlib warns where the search for the best place takes longer than a second."""
    seeking = re.compile(r"\.legend\((?![^()]*loc=)[^()]*\)")
    drawing = [*tour.scripts(), *ROOT.glob("training/**/*.py"), *ROOT.glob("experiments/**/*.py")]
    found = [path.name for path in drawing if seeking.search(path.read_text("utf-8"))]
    assert found == []
    assert seeking.search("axes.legend(ncols=2)")


def test_most_of_the_tour_has_pictures() -> None:
    pages = [tour.page_of(path.with_suffix(".ipynb")) for path in tour.scripts()]
    assert sum(bool(page.pictures) for page in pages) >= 9


def test_the_page_of_examples_lists_every_part() -> None:
    text = (ROOT / "docs/examples.md").read_text("utf-8")
    listed = re.findall(r"^\| \[(\d\d_\w+\.ipynb)\]", text, re.MULTILINE)
    assert listed == [path.with_suffix(".ipynb").name for path in tour.scripts()]
