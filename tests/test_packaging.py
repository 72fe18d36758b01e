"""What is installed is what is on disk, under the name that it should have."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
MAPPED = ("envs", "baselines", "params", "training")


def _project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def _packages_on_disk() -> set[str]:
    found = set()
    for folder, name in [("cjt_gym", "cjt_gym"), *((m, f"cjt_gym.{m}") for m in MAPPED)]:
        for init in (ROOT / folder).rglob("__init__.py"):
            found.add(".".join([name, *init.parent.relative_to(ROOT / folder).parts]))
    return found


def test_listed_packages_are_those_on_disk() -> None:
    assert set(_project()["tool"]["setuptools"]["packages"]) == _packages_on_disk()


def test_every_source_folder_is_a_package() -> None:
    roots = [ROOT / "cjt_gym", *(ROOT / m for m in MAPPED)]
    folders = {source.parent for root in roots for source in root.rglob("*.py")}
    assert [str(f) for f in sorted(folders) if not (f / "__init__.py").exists()] == []


@pytest.mark.parametrize("name", MAPPED)
def test_mapped_folder_refuses_to_be_a_top_level_package(name: str) -> None:
    init = ROOT / name / "__init__.py"
    spec = importlib.util.spec_from_file_location(name, init)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.raises(ImportError, match=rf"cjt_gym\.{name}"):
        spec.loader.exec_module(module)


@pytest.mark.parametrize("name", MAPPED)
def test_mapped_folder_is_a_subpackage(name: str) -> None:
    module = importlib.import_module(f"cjt_gym.{name}")
    assert module.__name__ == f"cjt_gym.{name}"


def test_core_dependencies_are_light() -> None:
    core = " ".join(_project()["project"]["dependencies"])
    assert not any(heavy in core for heavy in ("torch", "stable", "can"))


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("cjt_gym.envs, cjt_gym.baselines", ("scipy.signal", "control")),
        ("cjt_gym.gap.diagnose, cjt_gym.gap.report", ()),
    ],
)
def test_import_leaves_what_is_heavy_alone(name: str, more: tuple[str, ...]) -> None:
    heavy = ("torch", "stable_baselines3", "matplotlib", "can", "pyarrow", *more)
    code = f"import sys, {name}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.strip() == "[]"


def test_constraints_pin_every_direct_dependency_that_is_installed() -> None:
    pinned = _pinned()
    project = _project()["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    for requirement in (r for group in groups for r in group if not r.startswith("cjt-gym")):
        assert _name(requirement) in pinned


def test_constraints_agree_with_this_environment() -> None:
    for name, version in _pinned().items():
        try:
            installed = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
        assert installed.split("+")[0] == version, name


def test_wheel_holds_code_data_and_licence(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path)],
        cwd=_copy_of_sources(tmp_path / "sources"),
        check=True,
        capture_output=True,
        timeout=300,
    )
    (wheel,) = tmp_path.glob("*.whl")
    version = _project()["project"]["version"]
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {name.split("/")[0] for name in names} == {"cjt_gym", f"cjt_gym-{version}.dist-info"}
    for joint in (ROOT / "params").glob("*.toml"):
        assert f"cjt_gym/params/{joint.name}" in names
    for data in (ROOT / "cjt_gym" / "records" / "data").rglob("*.*"):
        assert data.relative_to(ROOT).as_posix() in names
    assert "cjt_gym/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)


def _copy_of_sources(target: Path) -> Path:
    skip = shutil.ignore_patterns("__pycache__", "*.pyc")
    target.mkdir()
    for folder in ("cjt_gym", *MAPPED):
        shutil.copytree(ROOT / folder, target / folder, ignore=skip)
    for name in ("pyproject.toml", "README.md", "LICENSE", "NOTICE"):
        shutil.copy(ROOT / name, target / name)
    return target


def _name(requirement: str) -> str:
    name = requirement.split(";")[0]
    for sign in "<>=!~[ ":
        name = name.split(sign)[0]
    return _canonical(name)


def _canonical(name: str) -> str:
    return name.strip().lower().replace("_", "-").replace(".", "-")


def _pinned() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {_canonical(name): version.strip() for name, version in pairs}
