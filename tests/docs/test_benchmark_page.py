"""The page of the benchmark: its Python runs, its tables name all there is."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from cjt_gym.analysis import Figures
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS
from cjt_gym.training.tuning.limits import Limits
from tests.python import run_python

PAGE = (Path(__file__).parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, flags=re.S)


def test_the_python_of_the_page_runs() -> None:
    (code,) = (text for kind, text in BLOCKS if kind == "python")
    run = run_python(code)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("True ('coulomb',)\n")


def test_tables_name_all_there_is() -> None:
    for name, row in BENCHMARK_TASKS.items():
        assert f"| `{name}` | {row.summary}" in PAGE
    for figure in fields(Figures):
        assert f"`{figure.name}`" in PAGE or figure.name == "stable"
    for limit in fields(Limits):
        assert f"`--{limit.name.replace('_', '-')}`" in PAGE
