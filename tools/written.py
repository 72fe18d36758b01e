"""Files of the documentation that a tool writes, or with `--check` compares."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path


def write_or_check(tool: str, path: Path, text: str, words: Sequence[str] | None = None) -> int:
    """Write a text to its file or, with `--check`, fail where the file holds another.

    Args:
        tool: Module that makes the text.
        path: The file.
        text: What it shall hold.
        words: Words of the command line.

    Returns:
        The exit status.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {tool}")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if it differs")
    if parser.parse_args(words).check:
        if path.exists() and path.read_text(encoding="utf-8") == text:
            return 0
        print(f"{path} differs: python -m {tool}", file=sys.stderr)
        return 1
    path.write_text(text, encoding="utf-8")
    print(path)
    return 0


def with_tables(text: str, tool: str, tables: Mapping[str, str]) -> str:
    """Return a page with its tables as they are now.

    A table stands between `<!-- NAME: python -m TOOL -->` and `<!-- end -->`, each on a line.
    """
    for name, table in tables.items():
        before, rest = text.split(begin := f"<!-- {name}: python -m {tool} -->\n")
        text = f"{before}{begin}{table}\n<!-- end -->{rest.split('<!-- end -->', 1)[1]}"
    return text
