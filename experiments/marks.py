"""What experiments come to: their results, and tables in a Markdown document between marks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cjt_gym.disk import write_text
from cjt_gym.errors import ConfigurationError, MissingFileError


def read_results(folder: Path, name: str) -> dict[str, Any]:
    """Return what the experiment NAME has written into `NAME.json` of a folder.

    Raises:
        MissingFileError: There is none.
    """
    try:
        data: dict[str, Any] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise MissingFileError(
            f"{folder} holds no {name}.json. Make it:  python -m experiments.{name} --out {folder}"
        ) from None
    return data


def markdown(cells: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; its first row is the head."""
    lines = [cells[0], ["---"] * len(cells[0]), *cells[1:]]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def fill(path: Path, label: str, parts: Mapping[str, str]) -> Path:
    """Write texts between the marks of a Markdown document, and return its path.

    A mark is `<!-- LABEL: NAME -->`, its end `<!-- end of LABEL: NAME -->`.

    Args:
        path: The document.
        label: Whose marks.
        parts: Name and text of each part; those that the document has no mark for are left out.

    Raises:
        MissingFileError: There is no such document.
        ConfigurationError: It has no mark, or one without an end.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MissingFileError(f"The document {path} does not exist.") from None
    marks = {
        name: (f"<!-- {label}: {name} -->", f"<!-- end of {label}: {name} -->") for name in parts
    }
    present = [name for name in parts if marks[name][0] in text]
    if not present:
        begin, end = next(iter(marks.values()))
        raise ConfigurationError(
            f"{path} has no place for {label}. Put {begin} and {end} into it, or the marks of "
            f"another part: {', '.join(parts)}."
        )
    for name in present:
        begin, end = marks[name]
        before, rest = text.split(begin, 1)
        if end not in rest:
            raise ConfigurationError(f"{path}: {begin} lacks its {end}.")
        text = f"{before}{begin}\n\n{parts[name]}\n\n{end}{rest.split(end, 1)[1]}"
    write_text(path, text)
    return path
