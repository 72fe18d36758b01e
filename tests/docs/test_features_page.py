"""The table of the toolbox's features: every command runs."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from cjt_gym.cli import main as cjt_gym

ROOT = Path(__file__).parents[2]

TABLE = """structures = ["rigid", "output_fixed"]
[joints]
plain = { file = "orange_80_6000" }
"""
PARAMETERS = "params.('k_b') = 21000;\nparams.('n') = 100; % ratio\n"
ROW = re.compile(
    r"^\| (?P<what>.+?) \| (?:-|`(?P<command>.+?)`) \| (?P<note>.*?) ?\|$", re.MULTILINE
)
SLOW = (
    "symbolic models",
    "spectra",
    "a PDF sheet",
    "a comparison",
    "a controller on a real actuator",
    "examples and a tour",
    "joints in models of whole robots",
)
"""Beginnings of the features whose commands take more than a second or two."""


class Feature(NamedTuple):
    """One row: what the toolbox offers, what does it here, and what differs."""

    what: str
    command: str
    note: str


PAGE = (ROOT / "docs" / "features.md").read_text(encoding="utf-8")
FEATURES = [Feature(**row.groupdict(default="")) for row in ROW.finditer(PAGE)]
RUN = [
    pytest.param(
        row, marks=[pytest.mark.slow] if row.what.startswith(SLOW) else [], id=row.what[:60]
    )
    for row in FEATURES
    if row.command
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with the files that the page assumes."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.toml").write_text(TABLE)
    (tmp_path / "example_params.m").write_text(PARAMETERS)
    law = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
    (snippet,) = (b for b in law.split("```python\n") if "class MyLaw" in b)
    (tmp_path / "mylaw.py").write_text(snippet.split("```")[0])
    shutil.copy(ROOT / "examples" / "hardware" / "joint.toml", tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    return tmp_path


def test_every_row_is_read_and_what_has_no_command_says_why() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    assert len(FEATURES) == sum("in the toolbox | here" not in row for row in rows) > 50
    assert all(row.command or row.note for row in FEATURES)


@pytest.mark.parametrize("row", RUN)
def test_the_command_runs(row: Feature, folder: Path) -> None:
    if not row.command.startswith(("cjt-gym ", "python ")):
        exec("from cjt_gym import load_joint\n" + row.command.replace("; ", "\n"), {})
        return
    words = shlex.split(row.command)
    if words[0] == "python":
        runpy.run_path(words[1], run_name="__main__")
        return
    assert cjt_gym(words[1:]) == 0
    if "--out" in words:
        assert (folder / words[words.index("--out") + 1]).exists()
