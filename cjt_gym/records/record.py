"""The one time series that simulation, hardware, evaluation and diagnosis exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
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
DT_FACTOR = 5.0
"""Factor between ``dt`` and the median interval of ``t`` above which a unit must be wrong."""


@dataclass(frozen=True, eq=False)
class Record:
    """A table of channels over time, with their units and what is known of where they come from.

    Columns and units are checked when the record is made, so that whoever receives one may rely on
    them. Arrays are copied and read-only. Columns that a record may hold: see
    :data:`cjt_gym.records.COLUMNS`; noise-free values carry the prefix ``true_``.

    Attributes:
        columns: Channels, each of shape (n,), float64.
        units: Unit of every column.
        dt: Nominal sample time [s]; None takes the median interval of ``t``. Where the record has
            ``t``, that is what counts.
        seed: Seed of the random numbers, where there were any.
        parameter_hash: Hash of the joint's parameters, where a joint made the record.
        joint: Name of the joint, or path of its file relative to ``origin``.
        structure: Structure of the joint, such as ``"output_fixed"``.
        versions: Version of each piece of software that made the record.
        provenance: Whatever else is known: mode, excitation, output, source, citation, gains ...
        sensors: For each channel its ``resolution`` and ``noise`` (standard deviation), in the
            channel's unit.
        allow_nan: Whether NaN stands for a sample that is missing. Otherwise NaN is an error.
        origin: File the record was read from.

    Example:
        >>> record = Record({"t": [0.0, 0.001], "q_m": [0.0, 0.1]}, {"t": "s", "q_m": "rad"})
        >>> record.dt, len(record), record["q_m"][1]
        (0.001, 2, 0.1)

    Raises:
        RecordError: An unknown column, a unit that the column cannot have, columns of different
            lengths, a time that does not increase or contradicts ``dt``, or a value that is not
            finite.
    """

    columns: Mapping[str, ArrayLike]
    units: Mapping[str, str]
    dt: float | None = None
    seed: int | None = None
    parameter_hash: str | None = None
    joint: str | None = None
    structure: str | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, SensorValue]] = field(default_factory=dict)
    allow_nan: bool = False
    origin: Path | None = None

    def __post_init__(self) -> None:
        columns = {
            name: _as_column(self.owner, name, values) for name, values in self.columns.items()
        }
        _check_units(self.owner, columns, dict(self.units))
        _check_lengths(self.owner, columns)
        _check_finite(self.owner, columns, self.allow_nan)
        settled: dict[str, object] = {
            "columns": columns,
            "units": {name: self.units[name] for name in columns},
            "dt": _sample_time(self.owner, columns, self.dt),
            "versions": dict(self.versions),
            "provenance": dict(self.provenance),
            "sensors": _sensor_values(self.owner, self.sensors, self.units),
        }
        for name, value in settled.items():
            object.__setattr__(
                self, name, MappingProxyType(value) if isinstance(value, dict) else value
            )

    @property
    def owner(self) -> str:
        """What error messages call this record."""
        return "the record" if self.origin is None else str(self.origin)

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column, of shape (n,).

        Raises:
            RecordError: The record has no such column.
        """
        try:
            values = self.columns[name]
        except KeyError:
            raise RecordError(
                f"{unknown_name('column', name, self.columns)} (in {self.owner})"
            ) from None
        assert isinstance(values, np.ndarray)
        return values

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __len__(self) -> int:
        return len(self[next(iter(self.columns))])

    def __eq__(self, other: object) -> bool:
        """Return whether values and facts are the same, wherever they were read from."""
        if not isinstance(other, Record):
            return NotImplemented
        return _facts(self) == _facts(other) and all(
            np.array_equal(self[name], other[name], equal_nan=True) for name in self.columns
        )

    __hash__ = None  # type: ignore[assignment]

    def __getstate__(self) -> dict[str, Any]:
        """Return plain dictionaries, which can be pickled for another process."""
        return {
            name: dict(value) if isinstance(value, MappingProxyType) else value
            for name, value in vars(self).items()
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        rebuilt = Record(**state)
        for name, value in vars(rebuilt).items():
            object.__setattr__(self, name, value)

    @property
    def t(self) -> FloatArray:
        """Time of every sample [s], shape (n,): the column ``t``, or else multiples of ``dt``."""
        if "t" in self.columns:
            return self["t"]
        assert self.dt is not None
        return np.arange(len(self), dtype=np.float64) * self.dt

    @property
    def prismatic(self) -> bool:
        """Whether the axis moves in metres and newtons."""
        return any(unit in PRISMATIC for unit in self.units.values())

    @property
    def joint_file(self) -> str | Path | None:
        """The joint to load: the file of that name beside the record, else the bare name."""
        if self.joint is None or self.origin is None:
            return self.joint
        beside = self.origin.parent / self.joint
        return beside if beside.is_file() else self.joint

    def slice(self, start: int | None = None, stop: int | None = None) -> Record:
        """Return the samples from ``start`` up to but not including ``stop``, as in a Python slice.

        Raises:
            RecordError: Nothing is left.
        """
        return replace(self, columns={name: self[name][start:stop] for name in self.columns})

    def with_columns(
        self, columns: Mapping[str, ArrayLike], units: Mapping[str, str] | None = None
    ) -> Record:
        """Return a copy with some columns added or replaced.

        Args:
            columns: The new values, each of shape (n,).
            units: Units of the columns that the record did not have.

        Raises:
            RecordError: As for the record itself.
        """
        return replace(
            self, columns={**self.columns, **columns}, units={**self.units, **(units or {})}
        )

    def to_csv(self, path: str | Path) -> Path:
        """Write the record as CSV (17 digits) with its ``.toml`` beside it; return the path."""
        from cjt_gym.records.files import write_record

        return write_record(self, Path(path).with_suffix(".csv"))

    def to_parquet(self, path: str | Path) -> Path:
        """Write the record as Parquet with its ``.toml`` beside it; return the path.

        Raises:
            RecordError: pyarrow is not installed.
        """
        from cjt_gym.records.files import write_record

        return write_record(self, Path(path).with_suffix(".parquet"))

    def to_npz(self, path: str | Path) -> Path:
        """Write the record as compressed NPZ with its ``.toml`` beside it; return the path."""
        from cjt_gym.records.files import write_record

        return write_record(self, Path(path).with_suffix(".npz"))


def _facts(record: Record) -> tuple[object, ...]:
    scalars = (record.dt, record.seed, record.parameter_hash, record.joint, record.structure)
    tables = (
        record.units,
        record.versions,
        record.provenance,
        {name: dict(known) for name, known in record.sensors.items()},
    )
    return (*scalars, *(dict(table) for table in tables))


def _as_column(owner: str, name: str, values: ArrayLike) -> FloatArray:
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


def _check_units(owner: str, columns: Mapping[str, FloatArray], units: dict[str, str]) -> None:
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


def _check_lengths(owner: str, columns: Mapping[str, FloatArray]) -> None:
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
            )


def _check_finite(owner: str, columns: Mapping[str, FloatArray], allow_nan: bool) -> None:
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


def _sample_time(owner: str, columns: Mapping[str, FloatArray], dt: float | None) -> float:
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise RecordError(f"dt of {owner} must be > 0 s, got {dt}.")
    if "t" not in columns or len(columns["t"]) < 2:
        if dt is None:
            raise RecordError(f"{owner} must have a column t or a sample time. Add  dt = ...  [s].")
        return float(dt)
    steps = np.diff(columns["t"])
    if (steps <= 0).any():
        where = int(np.argmax(steps <= 0))
        raise RecordError(
            f"The time t of {owner} must increase from sample to sample, got "
            f"{columns['t'][where]} s and then {columns['t'][where + 1]} s at sample {where + 1}. "
            "Sort the samples and drop repeated ones."
        )
    median = float(np.median(steps))
    if dt is not None and not dt / DT_FACTOR <= median <= dt * DT_FACTOR:
        raise RecordError(
            f"dt of {owner} says {dt} s, but the median interval of t is {median:g} s. "
            "Give both in seconds, or leave dt out."
        )
    return median if dt is None else float(dt)


def _sensor_values(
    owner: str, sensors: Mapping[str, Mapping[str, SensorValue]], units: Mapping[str, str]
) -> dict[str, Mapping[str, float]]:
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
