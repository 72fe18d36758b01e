"""Reads the tables of a configuration; every mistake is one clear error."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cjt_gym.errors import ConfigurationError, ParameterError, check_range, unknown_key
from cjt_gym.joint.files.quantity import parse_quantity
from cjt_gym.joint.files.units import in_usual_unit

REQUIRED: Any = object()
"""Stands for the default of a key that must be given."""


class Section:
    """A table with a method for each kind of value.

    Each method returns the default, if it has one, for an absent key, and raises ConfigurationError
    for a missing or invalid value.
    """

    def __init__(self, table: object, owner: str, known: Iterable[str] | None = None) -> None:
        """Take a table."""
        if not isinstance(table, Mapping):
            raise ConfigurationError(f"{owner} must be a table, got {table!r}.")
        self.table: Mapping[str, Any] = table
        self.owner = owner
        names = list(table) if known is None else list(known)
        for key in table:
            if key not in names:
                raise ConfigurationError(unknown_key(owner, key, names))

    def __contains__(self, key: str) -> bool:
        return key in self.table

    def _given(self, key: str, form: str, default: Any) -> Any:
        """Return a value or its default, which is valid."""
        value = self.table.get(key, default)
        if value is REQUIRED:
            raise ConfigurationError(f"{self.owner} lacks the key '{key}'. Add  {key} = {form}.")
        return value

    def text(self, key: str, default: Any = REQUIRED) -> Any:
        """Return a non-empty string."""
        value = self._given(key, '"..."', default)
        if value is not default and (not isinstance(value, str) or not value):
            raise ConfigurationError(f"{key} of {self.owner} must be a string, got {value!r}.")
        return value

    def choice(self, key: str, allowed: Sequence[str]) -> str:
        """Return one of some strings; the first is the default."""
        value = self.table.get(key, allowed[0])
        if value not in allowed:
            raise ConfigurationError(
                f"{key} of {self.owner} must be one of {', '.join(allowed)}, got {value!r}."
            )
        return str(value)

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.table.get(key, default)
        if not isinstance(value, bool):
            raise ConfigurationError(f"{key} of {self.owner} must be true or false, got {value!r}.")
        return value

    def whole(self, key: str, low: int, high: int, default: Any = REQUIRED) -> Any:
        """Return a whole number from `low` to `high`."""
        value = self._given(key, str(low), default)
        if value is default:
            return default
        check_range(f"{key} of {self.owner}", value, low=low, high=high, whole=True)
        return value

    def number(
        self,
        key: str,
        unit: str,
        above: float = 0.0,
        high: float = math.inf,
        default: Any = REQUIRED,
        low: float = -math.inf,
    ) -> Any:
        """Return a plain number more than `above`, from `low` to `high` [unit]."""
        value = self._given(key, "...", default)
        if value is default:
            return default
        check_range(f"{key} of {self.owner}", value, unit, above=above, low=low, high=high)
        return float(value)

    def quantity(
        self,
        key: str,
        unit: str,
        low: float = -math.inf,
        high: float = math.inf,
        default: Any = REQUIRED,
    ) -> Any:
        """Return a value given in any unit of that kind, from `low` to `high` [unit]."""
        entry = self._given(key, f'{{ value = ..., unit = "{unit}" }}', default)
        if entry is default:
            return default
        try:
            given = parse_quantity(entry, f"{key} of {self.owner}")
            value = in_usual_unit(given, (unit,), f"{key} of {self.owner}").number
        except ParameterError as error:
            raise ConfigurationError(str(error)) from None
        check_range(f"{key} of {self.owner}", value, unit, low=low, high=high, finite=False)
        return value
