"""The page of characteristics is what the tables say, and its examples run."""

from __future__ import annotations

import re

import pytest

import cjt_gym.characteristics
from tools.characteristics_page import PAGE, main

TEXT = PAGE.read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def test_the_committed_page_is_what_the_tables_say(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("example", EXAMPLES)
def test_its_examples_run(example: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(example, PAGE.name, "exec"), {})
    assert capsys.readouterr().out


def test_it_names_functions_that_exist() -> None:
    table = TEXT.split("## Curves and maps")[1].split("```")[0]
    names = {
        n for line in table.splitlines() for n in re.findall(r"`(\w+)`", line.split("gives")[0])
    }
    found = {name for name in names if hasattr(cjt_gym.characteristics, name)}
    assert names - found <= {"peak", "lasting"}
