"""The pages of the documentation, and the code on them."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SHORTENED = {
    ("train",): ["--steps", "2048", "--quiet"],
    ("benchmark",): ["--episodes", "1"],
    ("diagnose", "emps"): ["--seconds", "10"],
    ("hardware",): ["--duration", "2"],
}
"""What is added to commands that begin with these words, for them to take seconds."""


def page(name: str) -> str:
    """Return the text of a page, as of `hardware` or `tutorials/hardware`."""
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def blocks(text: str, language: str = "python") -> list[str]:
    """Return the blocks of code on a page that are in a language, as in `python` or `sh|bash`."""
    return re.findall(rf"```(?:{language})\n(.*?)```", text, re.DOTALL)


def commands(text: str) -> list[list[str]]:
    """Return the commands of `cjt-gym` on a page in order, each as the words after that name."""
    lines = [line for block in blocks(text, "sh|bash") for line in block.splitlines()]
    words = [shlex.split(line, comments=True) for line in lines]
    return [rest for first, *rest in filter(None, words) if first == "cjt-gym"]


def shortened(words: list[str]) -> list[str]:
    """Return a command with what makes it short."""
    more = (extra for begin, extra in SHORTENED.items() if tuple(words[: len(begin)]) == begin)
    return [*words, *next(more, [])]
