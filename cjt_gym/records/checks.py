"""What a record has to satisfy; every function raises RecordError where it does not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.columns import (
    PRISMATIC,
    TRUE_PREFIX,
    check_one_axis,
    check_unit,
    column_of,
    default_units,
)

FloatArray = NDArray[np.float64]


class HasUnit(Protocol):
    """A value that knows its unit, such as a quantity of a joint file."""

    @property
    def value(self) -> Any:
        """The number."""

    @property
    def unit(self) -> str:
        """Its unit."""


SensorValue = float | HasUnit
SENSOR_KEYS = ("resolution", "noise")
DIGITS = 12
"""Of a sample time that differences of times give: what rounding them leaves is no more exact."""
DT_FACTOR = 5.0
"""Factor between ``dt`` and the median interval of ``t`` above which a unit must be wrong."""


def as_column(owner: str, name: str, values: ArrayLike) -> FloatArray:
    """Return the values of a column as a read-only copy, shape (n,)."""
    column_of(name)
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise RecordError(
            f"Column {name!r} of {owner} must hold real numbers, got the type {array.dtype}."
        )
    if array.ndim != 1:
        raise RecordError(
            f"Column {name!r} of {owner} must be one-dimensional, got the shape {array.shape}."
        )
    column: FloatArray = np.array(array, dtype=np.float64)
    column.setflags(write=False)
    return column


def check_units(owner: str, columns: Mapping[str, FloatArray], units: dict[str, str]) -> None:
    """Raise RecordError unless every column has one unit, and one that it may have."""
    for name in units:
        column_of(name)
    if without := [name for name in columns if name not in units]:
        raise RecordError(
            f'Column {without[0]!r} of {owner} has no unit. Add  {without[0]} = "..."  to [units].'
        )
    if absent := [name for name in units if name not in columns]:
        have = ", ".join(columns) or "none"
        raise RecordError(
            f"Column {absent[0]!r} of {owner} has a unit but is missing from the table. "
            f"Columns there: {have}."
        )
    for name, unit in units.items():
        check_unit(owner, name, unit)
    check_one_axis(owner, units)


def check_lengths(owner: str, columns: Mapping[str, FloatArray], mapping: str = "") -> None:
    """Raise RecordError unless there are samples, as many in each column that a mapping took."""
    lengths = {name: len(values) for name, values in columns.items()}
    if not lengths or not max(lengths.values()):
        raise RecordError(
            f"{owner} must hold at least one column with at least one sample, got none."
        )
    first = next(iter(lengths))
    for name, length in lengths.items():
        if length != lengths[first]:
            raise RecordError(
                f"All columns of {owner} must have the same length, got {lengths[first]} samples "
                f"of {first!r} and {length} of {name!r}."
                + (f" Map columns of the same rows in {mapping}, or give dt for t." * bool(mapping))
            )


def check_finite(owner: str, columns: Mapping[str, FloatArray], allow_nan: bool) -> None:
    """Raise RecordError where a value is infinite, or NaN and that is not allowed."""
    for name, values in columns.items():
        bad = ~np.isfinite(values)
        if allow_nan and name != "t":
            bad &= ~np.isnan(values)
        if bad.any():
            where = int(np.argmax(bad))
            remedy = (
                " Missing samples are accepted with allow_nan=True."
                if np.isnan(values[where]) and name != "t"
                else ""
            )
            raise RecordError(
                f"Column {name!r} of {owner} must be finite, got {values[where]} at sample {where}."
                f"{remedy}"
            )


def sample_time(owner: str, columns: Mapping[str, FloatArray], dt: float | None) -> float:
    """Return the sample time [s], given or from ``t``; RecordError where the two do not fit."""
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise RecordError(f"dt of {owner} must be > 0 s, got {dt}.")
    if "t" not in columns or len(columns["t"]) < 2:
        if dt is None:
            raise RecordError(
                f"{owner} must have a column t or a sample time: dt = ... [s] at the top of the "
                "TOML file beside it."
            )
        return float(dt)
    steps = np.diff(columns["t"])
    if (steps <= 0).any():
        where = int(np.argmax(steps <= 0))
        raise RecordError(
            f"The time t of {owner} must increase from sample to sample, got "
            f"{columns['t'][where]} s and then {columns['t'][where + 1]} s at sample {where + 1}. "
            "Sort the samples and drop repeated ones, as read_log does."
        )
    median = float(np.median(steps))
    if dt is not None and not dt / DT_FACTOR <= median <= dt * DT_FACTOR:
        raise RecordError(
            f"dt of {owner} says {dt} s, but the median interval of t is {median:g} s. "
            "Give both in seconds, or leave dt out."
        )
    return float(f"{median:.{DIGITS}g}") if dt is None else float(dt)


def sensor_values(
    owner: str, sensors: Mapping[str, Mapping[str, SensorValue]], units: Mapping[str, str]
) -> dict[str, Mapping[str, float]]:
    """Return plain numbers in the unit of their channel; RecordError for any other unit."""
    prismatic = any(unit in PRISMATIC for unit in units.values())
    usual = default_units(tuple(sensors), prismatic)
    return {
        channel: _sensor(owner, channel, known, units.get(channel, usual[channel]))
        for channel, known in sensors.items()
    }


def _sensor(
    owner: str, channel: str, known: Mapping[str, SensorValue], unit: str
) -> Mapping[str, float]:
    if channel.startswith(TRUE_PREFIX):
        raise RecordError(
            f"sensors of {owner} name {channel!r}, which is free of sensor effects by definition."
        )
    if wrong := [key for key in known if key not in SENSOR_KEYS]:
        raise RecordError(
            f"{unknown_name('sensor property', wrong[0], SENSOR_KEYS)} "
            f"(in sensors.{channel} of {owner})"
        )
    return {
        key: _in_unit(f"sensors.{channel}.{key} of {owner}", given, unit)
        for key, given in known.items()
    }


def _in_unit(what: str, given: SensorValue, unit: str) -> float:
    given_unit, number = (
        (unit, given) if isinstance(given, int | float) else (given.unit, given.value)
    )
    if given_unit != unit:
        raise RecordError(
            f"{what} must have the unit of its channel, {unit!r}, got {given_unit!r}."
        )
    value = float(number)
    if not (np.isfinite(value) and value >= 0):
        raise RecordError(f"{what} must be >= 0 {unit}, got {value}.")
    return value
