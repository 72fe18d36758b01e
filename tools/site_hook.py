"""What the site has beside its pages: the examples as files, and the page of the joints."""

from __future__ import annotations

import re
from pathlib import Path

from joints_page import joints_page
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every example as a file of the site, and the page of the joints."""
    files.append(File.generated(config, "joints.md", content=joints_page()))
    for path in sorted((ROOT / "examples").rglob("*.*")):
        if path.suffix in (".py", ".toml"):
            uri = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links that lead out of the folder of pages lead to the file in the site."""
    return re.sub(r"\]\(((?:\.\./)*)\.\./examples/", r"](\1examples/", markdown)
