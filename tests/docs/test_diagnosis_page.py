"""The Python of the page of the diagnosis runs."""

from __future__ import annotations

import re
from pathlib import Path

from tests.python import run_python

PAGE = (Path(__file__).parents[2] / "docs" / "diagnosis.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, flags=re.S)


def test_the_python_of_the_page_runs(tmp_path: Path) -> None:
    (code,) = (text for kind, text in BLOCKS if kind == "python")
    run = run_python(code, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith(("no_gap", "explained", "partly_explained", "unexplained"))
