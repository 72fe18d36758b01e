"""Every command of the documentation has the options shown; those of the tutorials run."""

from __future__ import annotations

import shlex
from importlib import import_module
from pathlib import Path

import pytest

from cjt_gym.cli import COMMANDS, Parser, main
from tests.docs.pages import DOCS, ROOT, blocks
from tests.docs.test_readme import SHORTENED

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
RUNNING = ("train", "benchmark", "diagnose")
"""Tutorials whose commands run here; those on hardware run in `test_hardware_pages.py`."""


def commands(page: Path) -> list[list[str]]:
    """Return the commands of a page in order, as words."""
    shown = blocks(page.read_text("utf-8"), "sh|bash")
    lines = [line for block in shown for line in block.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("cjt-gym ")]


SHOWN = {tuple(words[1:]): page.name for page in PAGES for words in commands(page)}


@pytest.mark.parametrize("words", SHOWN, ids=" ".join)
def test_commands_have_the_options_that_are_shown(words: tuple[str, ...]) -> None:
    if words[0].startswith("--"):
        assert words[0] in ("--help", "--version")
        return
    assert words[0] in COMMANDS
    parser = Parser(prog=words[0])
    import_module(f"cjt_gym.commands.{words[0].replace('-', '_')}").add_arguments(parser)
    parser.add_argument("--json", action="store_true")
    parser.parse_args(words[1:])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::cjt_gym.errors.OutsideFoundWarning")  # a training goes there
@pytest.mark.parametrize("page", RUNNING)
def test_commands_of_a_tutorial_run_one_after_the_other(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = commands(DOCS / "tutorials" / f"{page}.md")
    assert len(lines) > 3
    for _, *words in lines:
        assert main(words + SHORTENED.get(words[0], [])) == 0, (words, capsys.readouterr().err)
