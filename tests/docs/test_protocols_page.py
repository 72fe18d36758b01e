"""The page of protocols is what their tables say."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("canopen")

from cjt_gym.canbus.protocols import PROTOCOLS
from tests.docs.pages import blocks
from tools import protocols_page


def test_the_check_notices_a_changed_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(protocols_page, "PAGE", tmp_path / "protocols.md")
    assert protocols_page.main([]) == 0
    assert protocols_page.main(["--check"]) == 0
    (tmp_path / "protocols.md").write_text("other", encoding="utf-8")
    assert protocols_page.main(["--check"]) == 1
    assert "differs: python -m tools.protocols_page" in capsys.readouterr().err


def test_every_option_and_every_register_is_there() -> None:
    page = protocols_page.page()
    for row in PROTOCOLS.values():
        for option in row.options:
            assert f"| `{option}` |" in page
        for register in row.registers():
            assert register.name in page
            for field in register.fields:
                assert field.name in page


def test_tables_have_as_many_cells_as_their_heads() -> None:
    width = 0
    for line in protocols_page.page().splitlines():
        if not line.startswith("|"):
            width = 0
            continue
        cells = len(re.findall(r"(?<!\\)\|", line))
        width = width or cells
        assert cells == width, line


def test_the_example_of_a_trace_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (script,) = blocks(protocols_page.page())
    frames = []
    for k in range(300):
        stamp = 1.7e9 + 2e-3 * k
        frames += [
            f"({stamp:.6f}) can0 02E#{struct.pack('<ff', 0.01 * (k % 7), 0.0).hex()}",
            f"({stamp + 3e-4:.6f}) can0 029#{struct.pack('<ff', 0.001 * k, 0.5).hex()}",
            f"({stamp + 5e-4:.6f}) can0 10000300#{struct.pack('<fH', 0.02 * (k % 9), 0).hex()}",
        ]
    (tmp_path / "run.log").write_text("\n".join(frames) + "\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    made: dict[str, Any] = {}
    exec(script, made)
    (record,) = made["records"]
    assert {"t", "tau_cmd", "q_m", "dq_m", "tau"} <= set(record.columns)
    assert record["tau_cmd"][3] == pytest.approx(0.03 * 100.0)
