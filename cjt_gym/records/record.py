"""The one time series that simulation, hardware, evaluation and diagnosis exchange."""

from __future__ import annotations

import os
from collections.abc import KeysView, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.checks import (
    FloatArray,
    SensorValue,
    as_column,
    check_finite,
    check_lengths,
    check_units,
    sample_time,
    sensor_values,
)
from cjt_gym.records.columns import JOINT_MARK, PRISMATIC

JOINT_FILE = "joint_file"
"""Key of the provenance: path of the joint file that a record was made with."""
NO_FACTS = frozenset({"columns", "allow_nan", "origin"})
"""Fields of a record that are no facts by which two records differ."""


@dataclass(frozen=True, eq=False)
class Record:
    """A table of channels over time, with their units and what is known of where they come from.

    Columns and units are checked when the record is made, so that they need
    not be checked again. Arrays are copied and read-only. Columns that a record may hold: see
    :data:`cjt_gym.records.COLUMNS`; noise-free values carry the prefix ``true_``.

    Attributes:
        columns: Channels, each of shape (n,), float64.
        units: Unit of every column.
        dt: Nominal sample time [s]; left out, the median interval of ``t``. Where the record has
            ``t``, that is what counts.
        seed: Seed of the random numbers, where there were any.
        parameter_hash: Hash of the joint's parameters, where a joint made the record.
        joint: Name of the joint, or path of its file relative to ``origin``.
        structure: Structure of the joint, such as ``"output_fixed"``.
        versions: Version of each piece of software that made the record.
        provenance: Whatever else is known: mode, excitation, output, source, citation, gains ...
        sensors: For each channel its ``resolution`` and ``noise`` (standard deviation), in the
            channel's unit.
        allow_nan: Whether NaN marks a missing sample. Otherwise NaN is an error.
        origin: File the record was read from.

    Example:
        >>> record = Record({"t": [0.0, 0.001], "q_m": [0.0, 0.1]}, {"t": "s", "q_m": "rad"})
        >>> record.dt, len(record), record["q_m"].tolist()
        (0.001, 2, [0.0, 0.1])

    Raises:
        RecordError: An unknown column, a unit that the column cannot have, columns of different
            lengths, a time that does not increase or contradicts ``dt``, or a value that is not
            finite.
    """

    columns: Mapping[str, ArrayLike]
    units: Mapping[str, str]
    dt: float = None  # type: ignore[assignment]  # settled below, so that readers get a float
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
            name: as_column(self.owner, name, values) for name, values in self.columns.items()
        }
        check_units(self.owner, columns, dict(self.units))
        check_lengths(self.owner, columns)
        check_finite(self.owner, columns, self.allow_nan)
        settled: dict[str, object] = {
            "columns": columns,
            "units": {name: self.units[name] for name in columns},
            "dt": sample_time(self.owner, columns, self.dt),
            "versions": dict(self.versions),
            "provenance": dict(self.provenance),
            "sensors": sensor_values(self.owner, self.sensors, self.units),
        }
        for name, value in settled.items():
            object.__setattr__(
                self, name, MappingProxyType(value) if isinstance(value, dict) else value
            )

    @property
    def owner(self) -> str:
        """What error messages call this record."""
        return "the record" if self.origin is None else str(self.origin)

    def __repr__(self) -> str:
        rows, of = f"{len(self)} samples, {self.dt:g} s", self.joint or "no joint named"
        return f"<Record of {of}: {rows}, {', '.join(self.columns)}>"

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

    def keys(self) -> KeysView[str]:
        """Return the names of the columns, so that ``dict(record)`` gives them all."""
        return self.columns.keys()

    def __len__(self) -> int:
        return len(self[next(iter(self.columns))])

    def __eq__(self, other: object) -> bool:
        """Return whether values and facts are the same, wherever they were read from."""
        if not isinstance(other, Record):
            return NotImplemented
        facts = [field.name for field in fields(self) if field.name not in NO_FACTS]
        return all(getattr(self, name) == getattr(other, name) for name in facts) and all(
            np.array_equal(self[name], other[name], equal_nan=True) for name in self.columns
        )

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[type[Record], tuple[Any, ...]]:
        """Return what makes the record again, in plain dictionaries, which can be pickled."""
        values = (getattr(self, field.name) for field in fields(self))
        return Record, tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)

    @property
    def t(self) -> FloatArray:
        """Time of every sample [s], shape (n,): the column ``t``, or else multiples of ``dt``."""
        if "t" in self.columns:
            return self["t"]
        return np.arange(len(self), dtype=np.float64) * self.dt

    @property
    def prismatic(self) -> bool:
        """Whether the axis moves in metres and newtons."""
        return any(unit in PRISMATIC for unit in self.units.values())

    @property
    def joint_file(self) -> str | Path | None:
        """The joint to load, see `joint_to_load`; None where the record names none."""
        if self.joint is None:
            return None
        return joint_to_load(self.joint, self.provenance.get(JOINT_FILE), self.origin)

    @property
    def missing_joint(self) -> str:
        """That the joint file it names is missing, and where it was looked for; else empty."""
        if not isinstance(self.joint, str):
            return ""
        return missing_joint(self.joint, self.provenance.get(JOINT_FILE), self.origin)

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


def joint_to_load(name: str, made_with: object, origin: Path | None) -> str | Path:
    """Return the joint to load for a record.

    That is a file of that name beside the record; else the joint file that the record was made
    with, where it was or beside the record; else the bare name.
    """
    places = _places(name, made_with, origin)
    return next((place for place in places if os.path.isfile(place)), name)


def missing_joint(name: str, made_with: object, origin: Path | None) -> str:
    """Return that the joint file a record names is missing, and where it was looked for.

    An empty string where the file is there, or where the name is none of a file.
    """
    places = [*_places(name, made_with, origin), Path(name)]
    if not Path(name).suffix or any(os.path.isfile(place) for place in places):
        return ""
    tried = dict.fromkeys(str(place.absolute()) for place in places)
    return f"The joint file {name} does not exist. It was looked for as {', '.join(tried)}."


def _places(name: str, made_with: object, origin: Path | None) -> list[Path]:
    """Return where the joint file of a record may be."""
    places = [] if origin is None else [origin.parent / name]
    if isinstance(made_with, str):
        places.append(Path(made_with))
        if origin is not None:
            places.append(origin.parent / PurePath(made_with).name)
    return places


def joints_of(record: Record) -> tuple[str, ...]:
    """Return the names of the joints that a record holds, none where it holds only one."""
    names = (name.rpartition(JOINT_MARK)[0] for name in record.columns)
    return tuple(dict.fromkeys(name for name in names if name))


def part_of(record: Record, name: str) -> Record:
    """Return the part of one joint, see `one_joint`; of a record of one joint all of it."""
    return one_joint(record, name) if joints_of(record) else record


def one_joint(record: Record, name: str) -> Record:
    """Return the part of one joint, as a record of its own.

    Raises:
        RecordError: It holds no such joint.
    """
    known = joints_of(record)
    if name not in known:
        told = str(unknown_name(f"joint of {record.owner}", name, known))
        raise RecordError(told if known else f"{record.owner} is a record of one joint.")
    mark = name + JOINT_MARK
    columns = {k.removeprefix(mark): v for k, v in record.columns.items() if k.startswith(mark)}
    units = {k.removeprefix(mark): v for k, v in record.units.items() if k.startswith(mark)}
    sensors = {k.removeprefix(mark): v for k, v in record.sensors.items() if k.startswith(mark)}
    facts = {k: v for k, v in record.provenance.items() if k != "joints"}
    own = dict(record.provenance.get("joints", {}).get(name, {}))
    late = record.provenance.get("delays_s", {})
    facts |= {"delays_s": late[name]} if name in late else {}
    return replace(
        record,
        columns={"t": record.t, **columns},
        units={"t": "s", **units},
        sensors=sensors,
        joint=own.pop("joint", None),
        structure=own.pop("structure", None),
        parameter_hash=own.pop("parameter_hash", None),
        provenance=facts | own,
    )


def concat(records: Sequence[Record]) -> Record:
    """Return records that follow each other as one; what is known is taken from the first.

    Raises:
        RecordError: There is none, they differ in their columns or units, or the time of one does
            not follow that of the one before.
    """
    if not records:
        raise RecordError("concat needs at least one record, got none.")
    first = records[0]
    for record in records[1:]:
        if dict(record.units) != dict(first.units):
            raise RecordError(
                f"Records that are joined must have the same columns and units, got "
                f"{dict(first.units)} in {first.owner} and {dict(record.units)} in {record.owner}."
            )
    columns = {name: np.concatenate([record[name] for record in records]) for name in first.columns}
    allow_nan = any(record.allow_nan for record in records)
    return replace(first, columns=columns, allow_nan=allow_nan)
