"""The site: its links lead somewhere, its code runs, and it builds without a warning."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cjt_gym.joint import joint_names
from tests.python import run_python

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
TOUR = {f"tour/{path.stem}.md" for path in (ROOT / "examples/tour").glob("[0-9]*.py")}
GENERATED = {"joints.md", *TOUR}
PAGES = sorted(path.relative_to(DOCS) for path in DOCS.rglob("*.md"))
BLOCKS = [
    (page, text)
    for page in PAGES
    if page.parts[0] == "tutorials"
    for text in re.findall(r"```python\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)
]


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_lead_somewhere(page: Path) -> None:
    text = (DOCS / page).read_text("utf-8")
    for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if "://" not in link:
            beside = (DOCS / page).parent / link
            assert beside.exists() or (ROOT / link).exists(), link


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text("utf-8")))
    assert named == {page.as_posix() for page in PAGES} | GENERATED


def test_readers_choose_between_versions() -> None:
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))
    assert config["extra"]["version"]["provider"] == "mike"


def test_the_example_of_the_start_page_prints_what_is_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    start = (DOCS / "index.md").read_text("utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", start, re.DOTALL)
    (shown,) = re.findall(r"```text\n(.*?)```", start, re.DOTALL)
    exec(compile(code, "index.md", "exec"), {})
    printed = capsys.readouterr().out.split()
    assert printed[:2] == shown.split()[:2]
    for told in ("EXPLAINED.", "confirmed", "Coulomb"):
        assert told in shown.split()
        assert told in printed


@pytest.mark.slow
@pytest.mark.parametrize(("page", "text"), BLOCKS, ids=[f"{p.stem}" for p, _ in BLOCKS])
def test_code_of_tutorials_runs(page: Path, text: str, tmp_path: Path) -> None:
    run = run_python(text, cwd=tmp_path)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
def test_it_builds_without_a_warning(tmp_path: Path) -> None:
    subprocess.run([sys.executable, ROOT / "tools/link_tree.py"], check=True, capture_output=True)
    run = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    joints = (tmp_path / "site/joints.html").read_text("utf-8")
    assert all(f'id="{name}"' in joints for name in joint_names())
    assert (tmp_path / "site/effects.html").read_text("utf-8").count("<math ") >= 50
    for page in (tmp_path / "site").rglob("*.html"):
        text = page.read_text("utf-8")
        outside = re.findall(r'(?:src|<link[^>]*href)="(https?://[^"]+)', text)
        assert not outside, (page, outside)
        assert 'class="arithmatex"' not in text, page
