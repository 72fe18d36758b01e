"""Reading the tables of a configuration: every mistake is one clear error."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from cjt_gym.errors import ConfigurationError, ParameterError, did_you_mean
from cjt_gym.joint.quantity import parse_quantity

Table = Mapping[str, Any]
REQUIRED: Any = object()
"""Stands for the default of a key that must be given."""


def check_keys(table: object, known: Iterable[str], owner: str) -> Table:
    """Return the table.

    Raises:
        ConfigurationError: It is no table, or has a key that is not known.
    """
    if not isinstance(table, Mapping):
        raise ConfigurationError(f"{owner} must be a table, got {table!r}.")
    names = list(known)
    for key in table:
        if key not in names:
            raise ConfigurationError(
                f"{owner} has the unknown key '{key}'.{did_you_mean(key, names)} "
                f"Known: {', '.join(names)}."
            )
    return table


def text(table: Table, key: str, owner: str, default: Any = REQUIRED) -> Any:
    """Return a text.

    Raises:
        ConfigurationError: It is missing, empty or no text.
    """
    if key not in table and default is not REQUIRED:
        return default
    value = _given(table, key, owner, '"..."')
    if not isinstance(value, str) or not value:
        raise ConfigurationError(f"{key} of {owner} must be a text, got {value!r}.")
    return value


def flag(table: Table, key: str, owner: str, default: bool) -> bool:
    """Return true or false.

    Raises:
        ConfigurationError: It is neither.
    """
    value = table.get(key, default)
    if not isinstance(value, bool):
        raise ConfigurationError(f"{key} of {owner} must be true or false, got {value!r}.")
    return value


def whole(table: Table, key: str, owner: str, low: int, high: int, default: Any = REQUIRED) -> Any:
    """Return a whole number from `low` to `high`.

    Raises:
        ConfigurationError: It is missing or out of range.
    """
    if key not in table and default is not REQUIRED:
        return default
    value = _given(table, key, owner, str(low))
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ConfigurationError(
            f"{key} of {owner} must be a whole number from {low} to {high}, got {value!r}."
        )
    return value


def number(
    table: Table,
    key: str,
    owner: str,
    unit: str,
    low: float = 0.0,
    high: float = math.inf,
    default: Any = REQUIRED,
) -> Any:
    """Return a plain number above `low`, up to `high` [unit].

    Raises:
        ConfigurationError: It is missing or out of range.
    """
    if key not in table and default is not REQUIRED:
        return default
    value = _given(table, key, owner, "...")
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not (good and low < value <= high and math.isfinite(value)):
        top = "" if math.isinf(high) else f" and <= {high:g}"
        raise ConfigurationError(f"{key} of {owner} must be > {low:g}{top} {unit}, got {value!r}.")
    return float(value)


def quantity(
    table: Table,
    key: str,
    owner: str,
    unit: str,
    low: float = -math.inf,
    high: float = math.inf,
    default: Any = REQUIRED,
) -> Any:
    """Return a value that is written with its unit, from `low` to `high` [unit].

    Raises:
        ConfigurationError: It is missing, in another unit or out of range.
    """
    if key not in table and default is not REQUIRED:
        return default
    entry = _given(table, key, owner, f'{{ value = ..., unit = "{unit}" }}')
    try:
        given = parse_quantity(entry, f"{key} of {owner}")
        value = given.number
    except ParameterError as error:
        raise ConfigurationError(str(error)) from None
    if given.unit != unit:
        raise ConfigurationError(
            f"{key} of {owner} must be in {unit}, got the unit '{given.unit}'. Convert the value."
        )
    if not low <= value <= high:
        top = "" if math.isinf(high) else f" and <= {high:g}"
        bottom = "" if math.isinf(low) else f" >= {low:g}"
        raise ConfigurationError(
            f"{key} of {owner} must be{bottom}{top} {unit}, got {value:g}.".replace("be and", "be")
        )
    return value


def _given(table: Table, key: str, owner: str, form: str) -> Any:
    if key not in table:
        raise ConfigurationError(f"{owner} lacks the key '{key}'. Add  {key} = {form}.")
    return table[key]
