"""The page of controllers is what the table says, and its examples run."""

from __future__ import annotations

import re

import pytest

from tools.controllers_page import PAGE, main

EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def test_the_committed_page_is_what_the_table_says(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--check"]) == 0, capsys.readouterr().err


@pytest.mark.parametrize("example", EXAMPLES)
def test_its_examples_run(example: str) -> None:
    exec(compile(example, PAGE.name, "exec"), {})


def test_its_observer_has_the_poles_that_the_page_asks_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (example,) = [one for one in EXAMPLES if "observer.poles()" in one]
    exec(compile(example, PAGE.name, "exec"), {})
    printed = sorted(float(word) for word in re.findall(r"-\d+\.\d*", capsys.readouterr().out))
    assert printed == pytest.approx([-500.0, -440.0, -380.0], rel=1e-4)
