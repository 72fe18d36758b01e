"""Joint files written by tests."""

from __future__ import annotations

from pathlib import Path

HEAD = 'name = "mine"\nsource = "made up"\n'


def write(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def entries(*lines: str) -> str:
    return HEAD + "[parameters]\n" + "\n".join(lines) + "\n"
