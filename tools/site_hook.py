"""What the site needs beyond its pages: the examples as files, and docstrings as they are meant."""

from __future__ import annotations

import re
from pathlib import Path

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every example as a file of the site."""
    for path in sorted((ROOT / "examples").rglob("*.*")):
        if path.suffix in (".py", ".toml"):
            uri = path.relative_to(ROOT).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links that lead out of the folder of pages lead to the file in the site."""
    return re.sub(r"\]\(((?:\.\./)*)\.\./examples/", r"](\1examples/", markdown)


class PlainDocstrings(griffe.Extension):
    """Read docstrings as they are meant: ``Example:`` holds code, ``:func:`` is only a mark."""

    def on_instance(self, *, obj: griffe.Object, **_: object) -> None:
        """Rewrite the text of one docstring."""
        if obj.docstring:
            text = re.sub(
                r":(?:func|class|data|mod|meth):`~?([^`]+)`", r"`\1`", obj.docstring.value
            )
            obj.docstring.value = re.sub(r"(?m)^( *)Example:$", r"\1Examples:", text)
