"""The pages on data sheets and symbols: their Python runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cjt_gym.joint.build import build_joints

pytest.importorskip("sympy")

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "datasheet.md").read_text(encoding="utf-8")
TEXT += (DOCS / "symbolic.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", TEXT, flags=re.S)


@pytest.mark.parametrize("code", [text for kind, text in BLOCKS if kind == "python"])
def test_the_python_of_the_pages_runs(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "page", "exec"), {})
    assert capsys.readouterr().out


def test_the_table_of_the_page_is_eight_joints(tmp_path: Path) -> None:
    (table,) = (text for kind, text in BLOCKS if kind == "toml")
    (tmp_path / "table.toml").write_text(table, encoding="utf-8")
    assert len(build_joints(tmp_path / "table.toml")) == 8
