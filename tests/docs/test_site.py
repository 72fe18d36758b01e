"""The site: its links lead somewhere, and it builds without a warning."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cjt_gym.joint import joint_names
from tests.docs.pages import DOCS, ROOT, blocks, page

TOUR = {f"tour/{path.stem}.md" for path in (ROOT / "examples/tour").glob("[0-9]*.py")}
GENERATED = {"joints.md", *TOUR}
PAGES = sorted(path.relative_to(DOCS) for path in DOCS.rglob("*.md"))


@pytest.mark.parametrize("path", PAGES, ids=str)
def test_links_lead_somewhere(path: Path) -> None:
    text = (DOCS / path).read_text("utf-8")
    for link in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if "://" not in link:
            beside = (DOCS / path).parent / link
            assert beside.exists() or (ROOT / link).exists(), link


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text("utf-8")))
    assert named == {path.as_posix() for path in PAGES} | GENERATED


def test_readers_choose_between_versions() -> None:
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))
    assert config["extra"]["version"]["provider"] == "mike"


def test_the_example_of_the_start_page_prints_what_is_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (code,), (shown,) = blocks(page("index")), blocks(page("index"), "text")
    exec(compile(code, "index.md", "exec"), {})
    printed = capsys.readouterr().out.split()
    assert printed[:2] == shown.split()[:2]
    for told in ("EXPLAINED.", "confirmed", "Coulomb"):
        assert told in shown.split()
        assert told in printed


def test_the_example_of_evaluation_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(page("reference/training"))
    exec(compile(code, "training.md", "exec"), {})
    assert 0.0 < float(capsys.readouterr().out) < 20.0


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
    for path in (tmp_path / "site").rglob("*.html"):
        text = path.read_text("utf-8")
        outside = re.findall(r'(?:src|<link[^>]*href)="(https?://[^"]+)', text)
        assert not outside, (path, outside)
        assert 'class="arithmatex"' not in text, path
