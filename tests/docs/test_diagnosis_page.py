"""The page of the diagnosis: its Python runs, its commands have the options that they show."""

from __future__ import annotations

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from cjt_gym.cli import COMMANDS, Parser
from tests.python import run_python

PAGE = (Path(__file__).parents[2] / "docs" / "diagnosis.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, flags=re.S)
SHOWN = [line for kind, text in BLOCKS if kind == "sh" for line in text.splitlines() if line]


@pytest.mark.parametrize("line", SHOWN)
def test_commands_have_the_options_that_are_shown(line: str) -> None:
    words = shlex.split(line)
    assert words[0] == "cjt-gym"
    assert words[1] in COMMANDS
    parser = Parser(prog=words[1])
    import_module(f"cjt_gym.commands.{words[1]}").add_arguments(parser)
    parser.parse_args(words[2:])


def test_the_python_of_the_page_runs(tmp_path: Path) -> None:
    (code,) = (text for kind, text in BLOCKS if kind == "python")
    run = run_python(code, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(("no_gap", "explained", "partly_explained", "unexplained"))
