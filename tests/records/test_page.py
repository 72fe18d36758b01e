"""The page on records: its code runs, its tables are complete."""

from __future__ import annotations

import re
from pathlib import Path

from cjt_gym.records import COLUMNS, FORMATS, UNITS
from cjt_gym.records.mapping import KEYS
from cjt_gym.records.repair_notes import KINDS
from tests.docs.pages import blocks, page
from tests.python import run_python

PAGE = page("records")


def test_the_code_of_the_page_runs(tmp_path: Path) -> None:
    (mapping,) = blocks(PAGE, "toml")
    (tmp_path / "log.map.toml").write_text(mapping, encoding="utf-8")
    strict = "import warnings; warnings.simplefilter('error')"
    script = "\n".join([strict, *blocks(PAGE)])
    run = run_python(script, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    assert lines[0] == "q_m: 1 glitch (0.0333 %) marked as missing."
    assert lines[1] == "rad 3000 orange_80_6000"
    assert lines[2].startswith("q_m: sign turned (")


def test_nothing_is_left_out() -> None:
    named = set(re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", PAGE, flags=re.S)))
    assert set(FORMATS) <= named
    assert set(KEYS) <= named
    assert set(KINDS) <= named
    units = set(" ".join(named).split()) | named
    assert {unit for unit in UNITS if unit not in units} <= {"mNm", "Ncm"}


def test_the_page_lists_every_channel_with_its_units() -> None:
    for column in COLUMNS.values():
        row = f"| `{column.name}` | {', '.join(column.units)} | {column.description} |"
        assert row in PAGE
