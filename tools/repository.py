"""The public address of the project, from `pyproject.toml`, and what the site makes of it.

While there is none the site links to none: `[project.urls]` is filled in once.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from urllib.parse import urlparse

PROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"
GITHUB, COLAB = "github.com", "https://colab.research.google.com/github"
BRANCH = "main"


def repository(project: Path = PROJECT) -> str:
    """Return the address of the repository, an empty text while there is none."""
    facts = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
    return str(facts.get("urls", {}).get("Repository", "")).rstrip("/")


def owner_and_name(address: str) -> str:
    """Return the part of an address that names the repository, such as OWNER/NAME."""
    return urlparse(address).path.strip("/")


def badges(address: str, version: str) -> str:
    """Return the badges of the start page as HTML."""
    if not address:
        return ""
    rows = [
        ("version", version, f"{address}/releases"),
        ("licence", "Apache-2.0", f"{address}/blob/{BRANCH}/LICENSE"),
    ]
    if urlparse(address).netloc == GITHUB:
        rows.insert(1, ("tests", "CI", f"{address}/actions/workflows/ci.yml"))
    links = " ".join(
        f'<a class="badge" href="{to}"><span>{what}</span><b>{text}</b></a>'
        for what, text, to in rows
    )
    return f'<p class="badges">{links}</p>\n'


def notebook_badges(address: str, notebook: str) -> list[str]:
    """Return links that open a notebook elsewhere, as Markdown.

    Args:
        address: The repository.
        notebook: Path of the notebook in it.
    """
    if not address:
        return []
    links = [f"[Source]({address}/blob/{BRANCH}/{notebook}){{ .badge }}"]
    if urlparse(address).netloc == GITHUB:
        place = f"{COLAB}/{owner_and_name(address)}/blob/{BRANCH}/{notebook}"
        links.insert(0, f"[Open in Colab]({place}){{ .badge }}")
    return links
