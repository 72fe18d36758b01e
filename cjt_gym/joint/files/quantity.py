"""A number with its unit and source, its form in a joint file, and a read-only mapping."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from cjt_gym.errors import ParameterError, unknown_key

Value = TypeVar("Value")
WIDEST = 2.0
"""Largest tolerance; a larger one is a percentage by mistake, or a guess."""
QUANTITY_KEYS = ("value", "unit", "source", "tolerance", "guess", "asymmetric", "low", "high")


class FrozenMapping(Mapping[str, Value]):
    """A read-only mapping that compares, hashes and pickles by its content."""

    __slots__ = ("_items",)

    _items: dict[str, Value]

    def __init__(self, items: Mapping[str, Value] | None = None) -> None:
        self._items = dict(items or {})

    def __getitem__(self, key: str) -> Value:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(frozenset(self._items.items()))

    def __repr__(self) -> str:
        return repr(self._items)


@dataclass(frozen=True)
class Quantity:
    """A value with unit and origin.

    Attributes:
        value: A finite number, or several of them, in `unit`.
        unit: Unit as it is written in a joint file; "-" for a pure number.
        source: Where the value comes from; empty where the source of the whole file holds.
        tolerance: One sigma of the value, relative; None if unknown.
        asymmetric: For a negative-direction value only: it is meant to differ from its partner.
        low: Low end of the 95 % interval of the value, in `unit` and of its shape; None if unknown.
        high: High end of it.
        guess: Whether nothing is known of the value but its order of magnitude, so that a diagnosis
            may take any other; it has no tolerance then.
    """

    value: float | tuple[float, ...]
    unit: str
    source: str = ""
    tolerance: float | None = None
    asymmetric: bool = False
    low: float | tuple[float, ...] | None = None
    high: float | tuple[float, ...] | None = None
    guess: bool = False

    @property
    def number(self) -> float:
        """The value of a quantity that holds a single number [unit]."""
        if isinstance(self.value, tuple):
            raise ParameterError(
                f"A single number in {self.unit} is needed, got the list {list(self.value)}."
            )
        return self.value

    def converted(self, convert: Callable[[float], float], unit: str) -> Quantity:
        """Return the quantity in another unit; its interval is converted as its value is."""

        def each(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(convert, value))
            return None if value is None else convert(value)

        low, high = each(self.low), each(self.high)
        return replace(self, value=each(self.value), low=low, high=high, unit=unit)


Setting = Quantity | str  # what an entry of [effects.*] may be
Plain = bool | int | float | str | tuple["Plain", ...] | FrozenMapping["Plain"]
"""What an entry of [found] may be."""


def freeze(table: Mapping[str, object]) -> FrozenMapping[Plain]:
    """Return plain data that cannot be changed: lists as tuples, tables as `FrozenMapping`."""
    return FrozenMapping({key: _frozen(value) for key, value in table.items()})


def _frozen(value: object) -> Plain:
    if isinstance(value, Mapping):
        return freeze(value)
    if isinstance(value, list | tuple):
        return tuple(map(_frozen, value))
    return value if isinstance(value, bool | int | float | str) else str(value)


def parse_quantity(entry: object, owner: str) -> Quantity:
    """Return the quantity that a joint file writes as ``{ value = 1.0, unit = "rad" }``."""
    if not isinstance(entry, Mapping):
        raise ParameterError(
            f'{owner} must be written as {{ value = ..., unit = "..." }}, got {entry!r}.'
        )
    _check_keys(entry, owner)
    value = _parse_value(entry["value"], owner)
    low, high = _parse_interval(entry, value, owner)
    guess = _parse_flag(entry, "guess", owner)
    if guess and "tolerance" in entry:
        raise ParameterError(
            f"{owner} must have either a tolerance or guess = true (nothing is known), got both. "
            "Remove one of them."
        )
    return Quantity(
        value=value,
        unit=_parse_text(entry["unit"], f"unit of {owner}"),
        source=_parse_text(entry["source"], f"source of {owner}") if "source" in entry else "",
        tolerance=_parse_tolerance(entry["tolerance"], owner) if "tolerance" in entry else None,
        asymmetric=_parse_flag(entry, "asymmetric", owner),
        low=low,
        high=high,
        guess=guess,
    )


def _check_keys(entry: Mapping[str, object], owner: str) -> None:
    for key in entry:
        if key not in QUANTITY_KEYS:
            raise ParameterError(unknown_key(owner, key, QUANTITY_KEYS))
    for key in ("value", "unit"):
        if key not in entry:
            raise ParameterError(
                f"{owner} lacks the key '{key}'. Write {{ value = ..., unit = \"...\" }}."
            )


def _parse_value(value: object, owner: str) -> float | tuple[float, ...]:
    if isinstance(value, list):
        return tuple(_parse_number(item, owner) for item in value)
    return _parse_number(value, owner)


def _parse_interval(
    entry: Mapping[str, object], value: float | tuple[float, ...], owner: str
) -> tuple[float | tuple[float, ...], float | tuple[float, ...]] | tuple[None, None]:
    """Return both ends of the interval around a value; both must be given, or neither."""
    given = [key for key in ("low", "high") if key in entry]
    if not given:
        return None, None
    if len(given) == 1:
        raise ParameterError(
            f"{owner} must have both low and high, or neither, got only {given[0]}. Add the other."
        )
    low, high = _parse_value(entry["low"], owner), _parse_value(entry["high"], owner)
    rows = [x if isinstance(x, tuple) else (x,) for x in (low, value, high)]
    same = len({len(row) for row in rows}) == 1
    if not same or any(not a <= x <= b for a, x, b in zip(*rows, strict=True)):
        raise ParameterError(
            f"{owner} must lie from its low to its high, got low {low}, value {value}, high {high}."
        )
    return low, high


def _parse_number(value: object, owner: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(f"{owner} must be a number, got {value!r}.")
    if not math.isfinite(value):
        raise ParameterError(
            f"{owner} must be a finite number, got {value}. Leave the entry out if it is unknown."
        )
    return float(value) + 0.0  # turns -0.0 into 0.0, so that equal values hash alike


def _parse_text(value: object, owner: str) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ParameterError(f"The {owner} must be a text that is not empty, got {value!r}.")
    return value


def _parse_tolerance(value: object, owner: str) -> float:
    if isinstance(value, str):
        raise ParameterError(
            f"tolerance of {owner} must be a number, got {value!r}. If nothing is known of the "
            "value, write guess = true instead."
        )
    tolerance = _parse_number(value, f"tolerance of {owner}")
    if not 0.0 <= tolerance <= WIDEST:
        raise ParameterError(
            f"tolerance of {owner} must be >= 0 and at most {WIDEST:g} (one sigma, relative to the "
            f"value: 0.05 is 5 %), got {tolerance:.10g}. If nothing is known of the value, write "
            "guess = true instead."
        )
    return tolerance


def _parse_flag(entry: Mapping[str, object], key: str, owner: str) -> bool:
    value = entry.get(key, False)
    if not isinstance(value, bool):
        raise ParameterError(f"{key} of {owner} must be true or false, got {value!r}.")
    return value
