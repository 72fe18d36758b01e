"""The pages on hardware and emulator: their code runs, their tables are those of the code."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cjt_gym.canbus.config import BUS, CONTROL, EMULATOR, LIMITS, TABLES
from cjt_gym.canbus.experiments import EXPERIMENTS
from cjt_gym.canbus.safety import FAULTS
from cjt_gym.cli import main
from cjt_gym.records import read_record

ROOT = Path(__file__).parents[2]
HARDWARE = (ROOT / "docs" / "hardware.md").read_text(encoding="utf-8")
EMULATOR_PAGE = (ROOT / "docs" / "emulator.md").read_text(encoding="utf-8")
NEEDS_MORE = re.compile(r"bus\.recv|real\.csv")
"""Of code that needs a bus, or the record that was made before."""
CODE = re.findall(r"```python\n(.*?)```", HARDWARE + EMULATOR_PAGE, flags=re.S)


@pytest.mark.parametrize("text", [code for code in CODE if not NEEDS_MORE.search(code)])
def test_code_runs(text: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert run.returncode == 0, run.stderr


def test_every_key_experiment_and_fault_is_on_the_page() -> None:
    for name in (*TABLES, *BUS, *CONTROL, *LIMITS, *EMULATOR, *FAULTS, *EXPERIMENTS):
        assert name in HARDWARE, name
    for row in EXPERIMENTS.values():
        assert f"| `{row.name}` | {row.seconds:g} | {row.summary} |" in HARDWARE


def test_walk_through_runs_in_one_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    out = tmp_path / "real.csv"
    lines = [line for line in HARDWARE.splitlines() if line.startswith("cjt-gym hardware examples")]
    assert len(lines) == 3
    assert main(lines[1].split()[1:]) == 0
    assert "frames would be sent" in capsys.readouterr().out
    words = lines[2].replace("--arm", "--emulated").replace("runs/real.csv", str(out)).split()[1:]
    assert main([*words, "--duration", "1"]) == 0
    assert "tau" in read_record(out)
