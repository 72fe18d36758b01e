"""Write plain data as TOML."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cjt_gym.disk import toml_text


def to_toml(data: Mapping[str, Any]) -> str:
    """Return plain data as the text of a TOML file; None is left out.

    Values are booleans, numbers, texts, lists of these, and mappings, which become tables.

    Example:
        >>> print(to_toml({"steps": 10, "env": {"joint": "emps", "effects": {"coulomb": {}}}}))
        steps = 10
        <BLANKLINE>
        [env]
        joint = "emps"
        <BLANKLINE>
        [env.effects.coulomb]
        <BLANKLINE>

    Raises:
        TypeError: A value is of another kind.
    """
    return "\n".join(_table(data, ())).lstrip("\n") + "\n"


def _table(data: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    plain = {k: v for k, v in data.items() if v is not None and not isinstance(v, Mapping)}
    tables = {k: v for k, v in data.items() if isinstance(v, Mapping)}
    lines = []
    if path and (plain or not tables):
        lines += ["", f"[{'.'.join(path)}]"]
    lines += [f"{_key(k)} = {_value(v)}" for k, v in plain.items()]
    for key, table in tables.items():
        lines += _table(table, (*path, _key(key)))
    return lines


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
    raise TypeError(f"A TOML file cannot hold {value!r}.")
