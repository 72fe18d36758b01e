"""What contributors are told and what machines run agrees with the project."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import cjt_gym
from cjt_gym.cli import COMMANDS

ROOT = Path(__file__).resolve().parent.parent
GUIDES = ("CONTRIBUTING.md", "SECURITY.md", "docs/architecture.md")
FORMS = sorted((ROOT / ".github").rglob("*.yml"))


def _yaml(path: Path) -> Any:
    return yaml.safe_load(path.read_text("utf-8"))


def _project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_the_version_stands_in_one_place() -> None:
    version = _project()["version"]
    assert cjt_gym.__version__ == version
    assert "version" not in _yaml(ROOT / "CITATION.cff")
    sources = [path.read_text("utf-8") for path in (ROOT / "cjt_gym").rglob("*.py")]
    assert not any(f'"{version}"' in text for text in sources)


@pytest.mark.parametrize("guide", GUIDES)
def test_guides_name_what_exists(guide: str) -> None:
    text = (ROOT / guide).read_text("utf-8")
    made = ("tests/physics/test_effect_",)
    for name in re.findall(r"`([\w./-]+/[\w./-]+)`", text):
        if not name.startswith(made):
            assert (ROOT / name).exists(), name
    for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert ((ROOT / guide).parent / link).exists(), link
    for module in re.findall(r"python -m (tools[\w.]*)", text):
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or path.is_dir(), module
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for target in re.findall(r"^make ([a-z-]+)", text, re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target


@pytest.mark.parametrize("path", FORMS, ids=lambda path: path.name)
def test_workflows_and_forms_are_complete(path: Path) -> None:
    content = _yaml(path)
    if path.parent.name == "workflows":
        for job in content["jobs"].values():
            assert job["runs-on"]
            assert all("uses" in step or "run" in step for step in job["steps"])
        for target in re.findall(r"make ([a-z-]+)", path.read_text("utf-8")):
            assert f"\n{target}: " in (ROOT / "Makefile").read_text("utf-8"), target
    elif path.name != "config.yml":
        assert content["name"]
        assert all(field["attributes"]["label"] for field in content["body"])


def test_the_matrix_is_what_the_classifiers_say() -> None:
    matrix = _yaml(ROOT / ".github/workflows/ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    said = re.findall(r"Python :: (3\.\d+)", " ".join(_project()["classifiers"]))
    assert matrix["python"] == said


def test_pre_commit_formats_as_make_does() -> None:
    pinned = re.search(r"^ruff==(.*)$", (ROOT / "constraints.txt").read_text("utf-8"), re.M)
    assert pinned is not None
    hooks = {repo["repo"]: repo["rev"] for repo in _yaml(ROOT / ".pre-commit-config.yaml")["repos"]}
    assert hooks["https://github.com/astral-sh/ruff-pre-commit"] == f"v{pinned[1]}"


def test_the_citation_is_of_this_project() -> None:
    citation = _yaml(ROOT / "CITATION.cff")
    assert citation["license"] == _project()["license"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)


def test_the_changelog_is_kept_by_release() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    first, *others = re.findall(r"^## (.*)$", text, re.M)
    assert first == "[Unreleased]"
    assert all(re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", other) for other in others)


def test_every_room_is_drawn_and_described() -> None:
    from tools.architecture_page import DRAWING, PAGE, TEXTS, folder_of, rooms

    named = [room for layer in rooms() for room in layer]
    on_disk = {path.stem for path in (ROOT / "cjt_gym").iterdir() if path.suffix in ("", ".py")}
    beside = {"__pycache__", "__init__", "__main__", "registry"}
    assert on_disk - beside <= set(named)
    assert set(TEXTS) == set(named)
    page, svg = PAGE.read_text("utf-8"), DRAWING.read_text("utf-8")
    for room in named:
        assert f"| `{folder_of(room).relative_to(ROOT).as_posix()}` |" in page
        assert f">{room}</text>" in svg


def test_the_room_of_the_commands_holds_commands_only() -> None:
    files = {path.stem for path in (ROOT / "cjt_gym" / "commands").glob("*.py")} - {"__init__"}
    assert files == {name.replace("-", "_") for name in COMMANDS}
