"""The README's commands run, the long ones shortened; its targets, links and names exist."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

import cjt_gym  # noqa: F401
from tests.docs.pages import ROOT, commands, page, shortened

README = page("../README")


def test_commands_run_one_after_the_other(tmp_path: Path) -> None:
    shown = commands(README)
    wanted = {"simulate", "train", "benchmark", "diagnose", "check", "hardware"}
    assert {words[0] for words in shown} >= wanted
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for words in shown:
        run = subprocess.run(
            ["cjt-gym", *shortened(words)],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            check=False,
        )
        assert run.returncode == 0, (words, run.stderr)
        assert run.stdout
    found = [json.loads(path.read_text()) for path in named_in(tmp_path)]
    simulated, drive = ({e["name"]: e for e in one["effects"]} for one in found)
    before = {name: stage["before"] for name, stage in found[0]["where"]["stages"].items()}
    assert before["motor"] > 2.0 > before["transmission"]
    assert {name: e["status"] for name, e in simulated.items()} == {"coulomb": "confirmed"}
    assert simulated["coulomb"]["parameters"]["d_cm"]["value"] == pytest.approx(5.9, rel=0.05)
    assert set(drive) & {"damping", "coulomb", "coulomb_asym"}


def named_in(folder: Path) -> tuple[Path, Path]:
    """Return what was found in the simulated record and in that of the real drive."""
    return folder / "found" / "diagnosis.json", folder / "diagnosis" / "emps" / "diagnosis.json"


def test_every_make_target_of_the_readme_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"(?:^|`)make ([a-z-]+)", README, flags=re.M))
    assert targets >= {"demo", "test", "lint", "bench"}
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.M), target


def test_every_link_and_environment_of_the_readme_exists() -> None:
    for name in re.findall(r"CJT/\w+-v\d", README):
        assert name in gymnasium.registry
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert "://" in link or (ROOT / link).exists(), link


def test_the_readme_fits_two_screens() -> None:
    assert len(README.splitlines()) <= 110
    assert README.count("![") == 1
