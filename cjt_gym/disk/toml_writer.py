"""Plain data as the text of a TOML file."""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Mapping
from typing import Any


class Inline(dict[str, Any]):
    """A table that is written on one line."""


def to_toml(data: Mapping[str, Any]) -> str:
    """Return plain data as the text of a TOML file; None is left out.

    Values are booleans, numbers, texts, dates, lists of these and mappings, which become tables:
    `Inline` ones, and those within lists, on one line.

    Example:
        >>> print(to_toml({"a": 10, "env": {"k": Inline(value=2.0), "effects": {"coulomb": {}}}}))
        a = 10
        <BLANKLINE>
        [env]
        k = { value = 2.0 }
        <BLANKLINE>
        [env.effects.coulomb]
        <BLANKLINE>

    Raises:
        TypeError: A value is of another kind.
    """
    return "\n".join(_table(data, ())).lstrip("\n") + "\n"


def toml_text(text: str) -> str:
    r"""Return a text in quotes as TOML has it.

    Example:
        >>> print(toml_text('a "b"'))
        "a \"b\""
    """
    quoted = json.dumps(text, ensure_ascii=False)  # JSON's escapes are TOML's, but for two
    quoted = quoted.replace("\x7f", "\\u007f")
    return "".join("\\ufffd" if 0xD800 <= ord(c) < 0xE000 else c for c in quoted)


def _table(data: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    tables = {k: v for k, v in data.items() if isinstance(v, Mapping) and not isinstance(v, Inline)}
    plain = {k: v for k, v in data.items() if k not in tables and v is not None}
    lines = []
    if path and (plain or not tables):
        lines += ["", f"[{'.'.join(path)}]"]
    lines += [_entry(key, value) for key, value in plain.items()]
    for key, table in tables.items():
        lines += _table(table, (*path, _key(key)))
    return lines


def _entry(key: str, value: Any) -> str:
    return f"{_key(key)} = {_value(value)}"


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else toml_text(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return toml_text(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, Mapping):
        entries = ", ".join(_entry(k, v) for k, v in value.items() if v is not None)
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, (datetime.date, datetime.time)):
        return value.isoformat()
    raise TypeError(f"A TOML file cannot hold {value!r}.")
