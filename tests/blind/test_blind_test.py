"""The command from end to end, and that the diagnosing process has nothing to read the key from."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cjt_gym import cli
from cjt_gym.blind import KNOWN, OUTSIDE
from cjt_gym.blind.defects import ROUGH
from cjt_gym.blind.mix import BLOCKS, OF_SENSORS, recipe
from cjt_gym.blind.plan import can_go_together
from cjt_gym.blind.plant import STRUCTURES
from cjt_gym.commands import blind_test
from cjt_gym.gap import blind_case

KEY = {
    "effects": ["coulomb"],
    "outside_the_table": [],
    "parameters": {"coulomb": {"d_cm": 1.0}},
    "places": {"coulomb": "motor"},
    "signature": {"coulomb": 90.0},
    "structure": "rigid_gearbox",
    "true": {"I_g": 0.1},
    "stated": {"I_g": 0.1},
    "defects": {"gaps": {"empty": True}},
}
FOUND: dict[str, Any] = {"effects": [], "verdict": "no_gap", "seconds": 1.0}


@pytest.mark.parametrize("logs", BLOCKS)
def test_shares_of_a_block(logs: str) -> None:
    recipes = [recipe(3, k, logs=logs) for k in range(80)]
    assert Counter(r.kind for r in recipes) == {kind: 2 * n for kind, n in BLOCKS[logs].items()}
    singles = Counter(r.effects[0] for r in recipes if r.kind == "single")
    unseen = set(OF_SENSORS) if logs == "bare" else set()
    assert logs == "rough" or set(singles) == set(KNOWN) - unseen
    assert all(r.defects == ("bare",) for r in recipes) == (logs == "bare")
    assert max(singles.values()) == 2
    for r in recipes:
        assert can_go_together(r.effects)
        known = sum(name in KNOWN for name in r.effects)
        outside = sum(name in OUTSIDE for name in r.effects)
        expected = {"single": (1, 0), "pair": (2, 0), "none": (0, 0), "outside": (0, 1)}
        assert (known, outside) == expected.get(r.kind, (1, 1))
    assert recipes[17] == recipe(3, 17, logs=logs)
    assert recipes[17] != recipe(4, 17, logs=logs)


def test_every_defect_has_its_turn() -> None:
    assert all(recipe(3, k).defects == () for k in range(40))
    recipes = [recipe(3, k, logs="rough") for k in range(48)]
    count = Counter(name for r in recipes for name in r.defects)
    assert set(count) == set(ROUGH)
    assert all(r.defects for r in recipes)
    assert all(not {"missing", "command_only"} <= set(r.defects) for r in recipes)
    fewest = dict.fromkeys(ROUGH, 8) | {"missing": 1}
    assert all(count[name] >= fewest[name] for name in ROUGH)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_structure_can_be_asked_for(structure: str) -> None:
    assert {recipe(0, k, structure).structure for k in range(45)} == {structure}


def prepared(folder: Path, names: list[str]) -> None:
    """Write cases as if they had been drawn."""
    settings = {"seed": 0, "structure": None, "strength": 1.0, "duration": 10.0}
    blind_test._write(folder / "settings.json", settings)
    for name in names:
        for file in blind_case.FILES:
            path = folder / "cases" / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{name} {file}")
        blind_test._write(folder / "labels" / f"{name}.json", KEY)


def test_diagnosing_process_is_handed_no_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it gets is a copy: the files of the case, in a folder of a folder of such copies."""
    handed = {}

    def spy(work: Any, jobs: dict[str, tuple[Path]], *_: Any) -> Any:
        assert work is blind_case.diagnose_case
        for name, arguments in jobs.items():
            (folder,) = arguments
            handed[name] = sorted(path.name for path in folder.iterdir())
            above = {path.relative_to(folder.parent) for path in folder.parent.rglob("*")}
            assert {path.parts[0] for path in above} == set(jobs)
            assert tmp_path not in folder.resolve().parents
            assert not any("coulomb" in p.read_text() for p in folder.iterdir())
            yield name, FOUND

    monkeypatch.setattr(blind_test, "_each", spy)
    prepared(tmp_path, ["case_000", "case_001"])
    blind_test._diagnose(["case_000", "case_001"], tmp_path, 1)
    assert handed == dict.fromkeys(("case_000", "case_001"), sorted(blind_case.FILES))


def test_folder_with_more_than_a_case_is_refused(tmp_path: Path) -> None:
    prepared(tmp_path, ["case_000"])
    folder = tmp_path / "cases" / "case_000"
    (folder / "labels.json").write_text("{}")
    with pytest.raises(ValueError, match="nothing else"):
        blind_case.diagnose_case(folder)


def test_failure_is_a_result(tmp_path: Path) -> None:
    prepared(tmp_path, ["case_000"])
    assert "error" in blind_case.diagnose_case(tmp_path / "cases" / "case_000")


def test_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Cases that are drawn or diagnosed are left alone; what failed is tried again."""
    asked = []

    def spy(work: Any, jobs: dict[str, Any], *_: Any) -> Any:
        asked.extend((work.__name__, name) for name in jobs)
        for name in jobs:
            yield name, FOUND

    monkeypatch.setattr(blind_test, "_each", spy)
    names = ["case_000", "case_001", "case_002"]
    prepared(tmp_path, names)
    blind_test._write(tmp_path / "diagnoses" / "case_000.json", FOUND)
    blind_test._write(tmp_path / "diagnoses" / "case_001.json", {"error": "RecordError: no"})
    words = ["blind-test", "--cases", "3", "--out", str(tmp_path)]
    assert cli.main(words) == 0
    assert asked == [("diagnose_case", "case_001"), ("diagnose_case", "case_002")]
    assert "first name right" in capsys.readouterr().out
    assert cli.main([*words, "--json"]) == 0
    assert len(asked) == 2
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "blind_test.json").read_text())
    assert printed["summary"]["first_right"]["known"] == pytest.approx(
        {"hits": 0, "total": 3, "share": 0.0, "low": 0.0, "high": 0.5615}, abs=1e-4
    )
    with (tmp_path / "cases.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [(row["truth"], row["defects"]) for row in table] == [("coulomb", "gaps")] * 3
    assert set(printed["summary"]["defects"]) == {"gaps", "all"}
    page = (tmp_path / "report.html").read_text()
    assert page.count("<svg") == 3
    cells = re.findall(r"<td[^>]*>([^<]*)", page)
    assert cells[cells.index("gaps") :][:3] == ["gaps", "3", "0 of 3, 0 %"]
    assert not any(loads in page for loads in ("<link", "<script", 'src="http', "url(http"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cases", "0"], "--cases must be >= 1"),
        (["--cases", "2", "--strength", "9"], "strength"),
        (["--cases", "2", "--structure", "rigit"], "Did you mean 'rigid'"),
        (["--cases", "2", "--logs", "rouhg"], "Did you mean 'rough'"),
        (["--cases", "2", "--seed", "5"], "other settings"),
        (["--cases", "2", "--logs", "rough"], "other settings"),
    ],
)
def test_mistakes_are_named(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prepared(tmp_path, [])
    assert cli.main(["blind-test", *words, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_from_end_to_end(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["blind-test", "--cases", "4", "--seed", "3", "--duration", "4", "--json"]
    words += ["--structure", "output_fixed_rigid_gearbox"]
    assert cli.main([*words, "--out", str(tmp_path)]) == 0
    result = json.loads(capfd.readouterr().out)
    assert [row["case"] for row in result["cases"]] == [f"case_{k:03d}" for k in range(4)]
    assert result["summary"]["failed"] == 0
    assert all(np.isfinite(row["seconds"]) for row in result["cases"])
    cases = {path.name for path in (tmp_path / "cases" / "case_000").iterdir()}
    assert cases == set(blind_case.FILES)
