"""Scripts beside the package import names that exist: no type checker reads all of them."""

from __future__ import annotations

import ast
import importlib
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("examples", "benchmarks", "tools", "experiments")
SCRIPTS = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_name_that_a_script_imports_from_the_package_exists(script: Path) -> None:
    tree = ast.parse(script.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "cjt_gym":
            for alias in node.names:
                assert exists(str(node.module), alias.name), f"{node.module}.{alias.name}"


def exists(module: str, name: str) -> bool:
    """Say whether a module of the package has a name, or a module within it of that name."""
    try:
        return hasattr(importlib.import_module(module), name) or _is_module(f"{module}.{name}")
    except ModuleNotFoundError as error:
        if str(error.name).startswith("cjt_gym"):
            return False
        pytest.skip(f"{module} needs {error.name}")


def _is_module(name: str) -> bool:
    return importlib.util.find_spec(name) is not None
