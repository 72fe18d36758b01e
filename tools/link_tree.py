"""Write the installed layout of the package as symlinks into .links/, for tools that read files.

The folders envs, baselines, params and training are sub-packages of cjt_gym once installed, but not
on disk. Type checkers and import-linter do not follow the import hook of an editable installation;
they follow this tree. The experiments, which are not installed, stand beside the package.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LINKS = ROOT / ".links"
PACKAGE = "cjt_gym"
EXPERIMENTS = "experiments"


def mapped_folders() -> dict[str, str]:
    """Return folder by sub-package, such as ``{"envs": "envs"}``, as pyproject.toml maps them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    mapping: dict[str, str] = project["tool"]["setuptools"]["package-dir"]
    return {name.removeprefix(f"{PACKAGE}."): folder for name, folder in mapping.items()}


def write_links() -> list[Path]:
    """Write the tree anew and return its links."""
    shutil.rmtree(LINKS, ignore_errors=True)
    (LINKS / PACKAGE).mkdir(parents=True)
    targets = {path.name: path for path in (ROOT / PACKAGE).iterdir() if path.name != "__pycache__"}
    targets |= {
        name: ROOT / folder for name, folder in mapped_folders().items() if (ROOT / folder).is_dir()
    }
    links = [_link(LINKS / PACKAGE / name, target) for name, target in sorted(targets.items())]
    return [*links, _link(LINKS / EXPERIMENTS, ROOT / EXPERIMENTS)]


def _link(link: Path, target: Path) -> Path:
    link.symlink_to(os.path.relpath(target, link.parent), target_is_directory=target.is_dir())
    return link


if __name__ == "__main__":
    print(f"{len(write_links())} links in {LINKS.name}/{PACKAGE}")
