"""The pages of the documentation, and the code on them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def page(name: str) -> str:
    """Return the text of a page, as of `hardware` or `tutorials/hardware`."""
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def blocks(text: str, language: str = "python") -> list[str]:
    """Return the blocks of code on a page that are in a language, as in `python` or `sh|bash`."""
    return re.findall(rf"```(?:{language})\n(.*?)```", text, re.DOTALL)
