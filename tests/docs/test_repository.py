"""The public address of the project is one setting, and the site does without it."""

from __future__ import annotations

from pathlib import Path

import yaml

from tools.repository import PROJECT, badges, notebook_badges, owner_and_name, repository

GITHUB, OTHER = "https://github.com/somebody/cjt_gym", "https://git.example.org/group/cjt_gym"
NOTEBOOK = "examples/tour/01_parameters.ipynb"


def test_the_address_comes_from_one_setting(tmp_path: Path) -> None:
    text = PROJECT.read_text(encoding="utf-8")
    assert repository() == ""
    filled = text.replace("# [project.urls]", "[project.urls]")
    filled = filled.replace("# Repository = ", "Repository = ").replace("OWNER", "somebody")
    path = tmp_path / "pyproject.toml"
    path.write_text(filled, encoding="utf-8")
    assert repository(path) == GITHUB
    assert owner_and_name(GITHUB) == "somebody/cjt_gym"


def test_without_an_address_there_are_no_badges() -> None:
    assert badges("", "1.0.0") == ""
    assert notebook_badges("", NOTEBOOK) == []


def test_badges_lead_to_the_repository() -> None:
    told = badges(GITHUB, "1.0.0")
    assert f'href="{GITHUB}/actions/workflows/ci.yml"' in told
    assert "<b>1.0.0</b>" in told
    assert "actions" not in badges(OTHER, "1.0.0")
    assert "src=" not in told  # nothing is loaded from elsewhere


def test_notebooks_open_where_the_host_allows_it() -> None:
    colab, source = notebook_badges(GITHUB, NOTEBOOK)
    assert f"/github/somebody/cjt_gym/blob/main/{NOTEBOOK})" in colab
    assert source.startswith(f"[Source]({GITHUB}/blob/main/{NOTEBOOK})")
    assert len(notebook_badges(OTHER, NOTEBOOK)) == 1


def test_readers_choose_between_versions() -> None:
    config = yaml.safe_load((PROJECT.parent / "mkdocs.yml").read_text("utf-8"))
    assert config["extra"]["version"]["provider"] == "mike"
