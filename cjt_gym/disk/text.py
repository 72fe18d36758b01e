"""TOML and JSON from files that are not trusted."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cjt_gym.disk.limits import BYTES_OF_TEXT
from cjt_gym.disk.parsing import parsing
from cjt_gym.errors import CjtGymError

DEEPEST: Final = 32
"""Tables and lists within each other."""
LARGEST: Final = 2**63
"""Whole numbers are smaller, as TOML has them; a float can hold them."""
PART: Final = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
LONG_KEY: Final = re.compile(rf"(?<![\w-])(?:{PART}\.[ \t]*+){{{2 * DEEPEST}}}")
Error = type[CjtGymError]


def read_text(path: Path, error: Error) -> str:
    """Return the text of a file in UTF-8.

    Raises:
        OSError: It cannot be opened.
        CjtGymError: Of the given class: it is too long, or not UTF-8.
    """
    limit = BYTES_OF_TEXT.value
    if "\0" in str(path):
        raise error(f"{str(path)!r} cannot be the name of a file.")
    with path.open("rb") as file:
        data = file.read(limit + 1)
    if len(data) > limit:
        BYTES_OF_TEXT.check(max(path.stat().st_size, limit + 1), path, error)
    with parsing(f"{path} must be a text in UTF-8", error, "Save it as UTF-8."):
        return data.decode("utf-8")


def read_toml(path: Path, error: Error) -> dict[str, Any]:
    """Return the content of a TOML file; see `parse_toml`."""
    return parse_toml(read_text(path, error), str(path), error)


def parse_toml(text: str, owner: str, error: Error) -> dict[str, Any]:
    """Return the content of a TOML text.

    Args:
        text: The text.
        owner: What error messages call it.
        error: Class of the error.

    Raises:
        CjtGymError: Of the given class: it is not TOML, nested deeper than `DEEPEST`, or has a
            whole number of more than 64 bits.
    """
    with parsing(f"{owner} must be a TOML file in UTF-8", error):
        _refuse_long_keys(text)
        document = tomllib.loads(text)
        _check(document)
        return document


def read_json(path: Path, error: Error) -> Any:
    """Return the content of a JSON file; see `parse_json`."""
    return parse_json(read_text(path, error), str(path), error)


def parse_json(text: str, owner: str, error: Error) -> Any:
    """Return what a JSON text says, under the conditions of `parse_toml`."""
    with parsing(f"{owner} must be JSON in UTF-8", error):
        document = json.loads(text)
        _check(document)
        return document


def _refuse_long_keys(text: str) -> None:
    """Refuse a key of many parts: the time that tomllib takes for one grows with their square."""
    if found := LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"line {line} has a key of more than {2 * DEEPEST} parts")


def _check(document: Any) -> None:
    """Check a document without a call per level."""
    level = [document]
    for _ in range(DEEPEST + 1):
        values: list[Any] = []
        for item in level:
            if isinstance(item, Mapping):
                values += [*item.keys(), *item.values()]
            elif isinstance(item, list):
                values += item
            elif isinstance(item, int) and abs(item) >= LARGEST:
                raise ValueError(f"a whole number has {math.log2(abs(item)):.0f} bits, 64 are read")
        if not values:
            return
        level = values
    raise ValueError(f"it is nested more than {DEEPEST} levels deep")
