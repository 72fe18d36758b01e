"""The README's code runs as it stands; its long commands run shortened."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.python import run_python

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.S)
PYTHON = [text for language, text in BLOCKS if language == "python"]
COMMANDS = [
    line.split("  #")[0].strip()
    for language, text in BLOCKS
    if language == "sh"
    for line in text.splitlines()
]
SHORTENED = {
    "train": ["--steps", "2048", "--quiet"],
    "tune": ["--budget", "2", "--episodes", "1"],
    "benchmark": ["--episodes", "2"],
    "hardware": ["--duration", "2"],
}


@pytest.mark.parametrize("text", PYTHON, ids=[str(k) for k in range(len(PYTHON))])
def test_python_blocks_run(text: str, tmp_path: Path) -> None:
    run = run_python(text, cwd=tmp_path)
    assert run.returncode == 0, run.stderr


def test_commands_run_one_after_the_other(tmp_path: Path) -> None:
    ours = [shlex.split(line) for line in COMMANDS if line.startswith("cjt-gym ")]
    wanted = {"simulate", "train", "benchmark", "diagnose", "check", "hardware"}
    assert {words[1] for words in ours} >= wanted
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for words in ours:
        run = subprocess.run(
            words + SHORTENED.get(words[1], []),
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            check=False,
        )
        assert run.returncode == 0, (words, run.stderr)
        assert run.stdout


def test_every_make_target_of_the_readme_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"(?:^|`)make ([a-z-]+)", README, flags=re.M))
    assert targets >= {"demo", "test", "lint", "bench"}
    for target in targets:
        assert re.search(rf"^{target}:", makefile, flags=re.M), target


def test_every_link_and_environment_of_the_readme_exists() -> None:
    import gymnasium

    import cjt_gym  # noqa: F401

    for name in re.findall(r"CJT/\w+-v\d", README):
        assert name in gymnasium.registry
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        assert "://" in link or (ROOT / link).exists(), link


def test_the_readme_fits_two_screens() -> None:
    assert len(README.splitlines()) <= 110
    assert README.count("![") == 1
