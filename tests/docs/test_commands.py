"""Every command of the documentation has the options shown; those of the tutorials run."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from cjt_gym.cli import COMMANDS, Parser, main
from tests.docs.pages import DOCS, ROOT, commands, page, shortened

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
SHOWN = {tuple(words): None for path in PAGES for words in commands(path.read_text("utf-8"))}
RUNNING = ("train", "benchmark", "diagnose")
"""Tutorials whose commands run here; those on hardware run in `test_hardware_pages.py`."""


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
@pytest.mark.parametrize("tutorial", RUNNING)
def test_commands_of_a_tutorial_run_one_after_the_other(
    tutorial: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    text = page(f"tutorials/{tutorial}")
    shown, told = commands(text), ""
    assert len(shown) > 3
    for words in shown:
        assert main(shortened(words)) == 0, (words, capsys.readouterr().err)
        told += capsys.readouterr().out
    if tutorial == "diagnose":
        answer = text.split("```text\nEXPLAINED")[1].split("```")[0]
        lines = ("EXPLAINED" + answer).replace("...", "").strip().splitlines()
        plain = told.replace("\N{NO-BREAK SPACE}", " ").replace("\N{NARROW NO-BREAK SPACE}", " ")
        assert [line for line in lines if line not in plain] == []
