"""Pages of the documentation: what tables say stands on them, and their Python runs."""

from __future__ import annotations

import re
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import cjt_gym.characteristics
from cjt_gym.analysis import Figures
from cjt_gym.joint.build import build_joints
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS
from cjt_gym.training.tuning.limits import Limits
from tests.docs.pages import DOCS, ROOT, blocks, page

WRITTEN_BY = (
    "characteristics_page",
    "controllers_page",
    "effects_page.__main__",
    "protocols_page",
)
TUTORIALS = sorted(f"tutorials/{path.stem}" for path in (DOCS / "tutorials").glob("*.md"))
PRINTED = {
    "../README": "",
    "benchmark": r"True \('coulomb',\)\n",
    "characteristics": ".",
    "controllers": "",
    "datasheet": ".",
    "diagnosis": "no_gap|explained|partly_explained|unexplained",
    "emulator": ".",
    "hardware": ".",
    "joint_files": r'structure = "rigid_gearbox"\n$',
    "symbolic": ".",
    **dict.fromkeys(TUTORIALS, ""),
}
"""Pages whose Python runs here, and what each piece of it prints first."""
NEEDS_MORE = re.compile(r"bus\.recv|real\.csv")
"""Of code that needs a bus, or a record: `test_hardware_pages.py` has these."""
EXAMPLES = [
    pytest.param(name, code, id=name, marks=[pytest.mark.slow] if name in TUTORIALS else [])
    for name in PRINTED
    for code in blocks(page(name))
    if not NEEDS_MORE.search(code)
]


@pytest.mark.parametrize("tool", WRITTEN_BY)
def test_a_page_that_is_written_is_what_the_tables_say(
    tool: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if tool == "protocols_page":
        pytest.importorskip("canopen")
    assert import_module(f"tools.{tool}").main(["--check"]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(("name", "code"), EXAMPLES)
def test_an_example_of_a_page_runs(
    name: str,
    code: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if name == "symbolic":
        pytest.importorskip("sympy")
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    registered = re.search(r"^\s*(import|from) cjt_gym", code, re.MULTILINE)
    assert registered or "CJT/" not in code, "environments are made by who imports cjt_gym"
    exec(compile(code, f"{name}.md", "exec"), {"__name__": "example"})
    assert re.match(PRINTED[name], capsys.readouterr().out)


@pytest.mark.slow
def test_an_identified_joint_does_what_its_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "example"}
    for code in blocks(page("after_the_diagnosis")):  # one program
        exec(compile(code, "after_the_diagnosis.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "Record a static phase with the joint torque tau" in printed
    assert names["gap"].after < 0.01 < 1.0 < names["gap"].before
    found = names["found"]
    assert found.identified.rmse == pytest.approx(found.recorded.rmse, rel=1e-3)
    assert found.nominal.rmse < 0.1 * found.recorded.rmse


def test_an_observer_has_the_poles_that_the_page_of_controllers_asks_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (example,) = [code for code in blocks(page("controllers")) if "observer.poles()" in code]
    exec(compile(example, "controllers.md", "exec"), {})
    printed = sorted(float(word) for word in re.findall(r"-\d+\.\d*", capsys.readouterr().out))
    assert printed == pytest.approx([-500.0, -440.0, -380.0], rel=1e-4)


def test_the_page_of_characteristics_names_functions_that_exist() -> None:
    table = page("characteristics").split("## Curves and maps")[1].split("```")[0]
    names = {
        n for line in table.splitlines() for n in re.findall(r"`(\w+)`", line.split("gives")[0])
    }
    found = {name for name in names if hasattr(cjt_gym.characteristics, name)}
    assert names - found <= {"peak", "lasting"}


def test_the_page_of_the_benchmark_names_tasks_figures_and_limits() -> None:
    text = page("benchmark")
    for name, row in BENCHMARK_TASKS.items():
        assert f"| `{name}` | {row.summary}" in text
    for figure in fields(Figures):
        assert f"`{figure.name}`" in text or figure.name == "stable"
    for limit in fields(Limits):
        assert f"`--{limit.name.replace('_', '-')}`" in text


def test_the_table_on_the_page_of_data_sheets_is_eight_joints(tmp_path: Path) -> None:
    (table,) = blocks(page("datasheet"), "toml")
    (tmp_path / "table.toml").write_text(table, encoding="utf-8")
    assert len(build_joints(tmp_path / "table.toml")) == 8
