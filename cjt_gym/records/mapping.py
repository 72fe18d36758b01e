"""Logs with other names, units and signs: a TOML file that says which column is which.

A mapping has a table per column of the record. All of its keys are optional:

==================  ===========================================================================
`source`            its name in the log (left out, the same), for MCAP ``/topic:field``, for traces
                    of a CAN bus ``/Message:Signal``
`unit`              its unit in the log, one of :data:`cjt_gym.records.units.UNITS`
`sign`              1 or -1
`scale`             a further factor, such as that of a sensor, or of `t` the length of a tick
`offset`            what the log shows where the value is zero, in the log's unit
`side`              "motor" where it is taken before the gear: angles and velocities are divided
                    by `n`, torques multiplied by it
`counts_per_rev`    counts of the encoder per revolution, for the units counts and counts/s
`time`              the log's column with the time of these samples, where they have their own
`time_unit`         its unit; left out, that of ``t``
`gain`              for torques that the log has in volts or amperes: what one of these makes, such
                    as ``{ value = 0.3, unit = "N m/V" }``
`samples_late`      by how many rows the log writes it late (negative: early), where a row holds
                    values of different instants; need not be whole for what is measured
==================  ===========================================================================

Beside the table `columns` stand the gear ratio `n` (left out, that of the joint) and whatever the
TOML file of a record may hold: `dt`, `joint`, `structure`, `sensors`, `provenance`. A table `can`
is for drives that are commanded by the same mapping, and not read here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final

from cjt_gym.disk import read_toml
from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.columns import COMMANDS, check_one_axis, column_of
from cjt_gym.records.metadata import checked_facts
from cjt_gym.records.units import COUNTS, UNITS, Unit, unit_of, units_of, usual_name

SUFFIX: Final = ".map.toml"
"""Ending of the mapping that is found beside a log of that name."""
GEARED: Final = {"rad": -1, "rad/s": -1, "N m": 1}
"""Power of the gear ratio that takes a unit from the motor's side to the link's."""
SIDES: Final = ("link", "motor")


@dataclass(frozen=True)
class ColumnSource:
    """Where a column of the record comes from: ``gain * (value - offset)`` of a log's column."""

    source: str  # name of the column in the log
    log_unit: str  # its unit there
    unit: str  # SI unit of the result
    gain: float  # factor from the log's values
    offset: float  # what the log shows where the value is zero, in the log's unit
    turn: float  # one revolution of an encoder in the record's unit; 0 where it is no angle
    time: str | None  # name of the log's column with its time; None for that of the record
    time_unit: str | None  # unit of that time; None for that of the record's
    samples_late: float = 0.0  # rows by which the log writes it late


@dataclass(frozen=True)
class ColumnMapping:
    """Which columns of a log make the columns of a record."""

    owner: str  # what error messages call it
    columns: Mapping[str, ColumnSource]  # for each column of the record where it comes from
    facts: Mapping[str, Any]  # arguments of the record other than its columns and units
    n: float | None = None  # gear ratio that takes the motor's side to the link's

    @property
    def units(self) -> dict[str, str]:
        """Unit of every column of the record."""
        return {name: column.unit for name, column in self.columns.items()}

    @property
    def late(self) -> dict[str, float]:
        """Rows by which columns are late in the log, for those that are."""
        return {n: column.samples_late for n, column in self.columns.items() if column.samples_late}


def load_mapping(mapping: str | Path | Mapping[str, Any], n: float | None = None) -> ColumnMapping:
    """Return a mapping, from its TOML file or as the same nested dictionaries.

    Args:
        mapping: The file or the dictionaries.
        n: Gear ratio of the joint, used where the mapping gives none.

    Raises:
        RecordError: The file is absent or is not TOML, or a key or its value is not valid.

    Example:
        >>> load_mapping({"columns": {"q_m": {"source": "pos", "unit": "deg"}}}).units
        {'q_m': 'rad'}
    """
    owner = "the mapping" if isinstance(mapping, Mapping) else str(mapping)
    return _mapping(owner, read_document(mapping), n)


def read_document(mapping: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """Return what a mapping says, unchecked."""
    if isinstance(mapping, Mapping):
        return dict(mapping)
    path = Path(mapping)
    try:
        return read_toml(path, RecordError)
    except OSError as error:
        raise RecordError(f"There is no mapping {path}: {error.strerror}.") from error


def _mapping(owner: str, document: dict[str, Any], n: float | None) -> ColumnMapping:
    columns, n = document.pop("columns", None), document.pop("n", n)
    document.pop("can", None)
    if not isinstance(columns, dict) or not columns:
        raise RecordError(
            f"{owner} must have a table per column, such as  [columns.q_m]  with  "
            f'source = "motor_pos_deg"  and  unit = "deg", got {columns!r}.'
        )
    if n is not None:
        n = _number(f"n of {owner}", n)
        if n < 0.0:
            raise RecordError(f"n of {owner} must be > 0, got {n:g}; sign = -1 turns a column.")
    if "units" in document:
        raise RecordError(f"{owner} must give the units under [columns], not under [units].")
    made = {name: _column(owner, name, given, n) for name, given in columns.items()}
    check_one_axis(owner, {name: column.unit for name, column in made.items()})
    return ColumnMapping(owner, made, checked_facts(owner, document), n)


KEYS: Final = (
    "source",
    "unit",
    "sign",
    "scale",
    "offset",
    "side",
    "counts_per_rev",
    "time",
    "time_unit",
    "gain",
    "samples_late",
)
OF_TIME: Final = ("source", "unit", "scale")
"""Keys that `t` may have."""
LATEST: Final = 1000
"""Rows by which a column may be late at most."""


def _column(owner: str, name: str, given: object, n: float | None) -> ColumnSource:
    what = f"columns.{name} of {owner}"
    try:
        column_of(name)
    except RecordError as error:
        raise RecordError(f"{error} (in {what})") from None
    if isinstance(given, str):
        given = {"source": given}
    if not isinstance(given, dict):
        raise RecordError(
            f'{what} must be a name or a table such as {{ source = "pos", unit = "deg" }}, '
            f"got {given!r}."
        )
    if wrong := [key for key in given if key not in KEYS]:
        raise RecordError(f"{unknown_name('key', wrong[0], KEYS)} (in {what})")
    if name == "t" and (wrong := [key for key in given if key not in OF_TIME]):
        raise RecordError(f"{what} may have source, unit and scale only, got {wrong[0]}.")
    if name == "t" and _number(f"scale of {what}", given.get("scale", 1.0)) < 0.0:
        raise RecordError(f"scale of {what} must be > 0, got {given['scale']}.")
    for key in ("source", "unit", "side", "time", "time_unit"):
        if not isinstance(given.get(key, ""), str):
            raise RecordError(f"{key} of {what} must be a string, got {given[key]!r}.")
    given = given | {k: usual_name(given[k]) for k in ("unit", "time_unit") if given.get(k)}
    unit_name = str(given.get("unit", "V" if "gain" in given else units_of(name)[0]))
    unit = _gained(what, name, given) or unit_of(name, unit_name, f"unit of {what}")
    gain = unit.factor * _sign(what, given) * _number(f"scale of {what}", given.get("scale", 1.0))
    turn = UNITS["rev"].factor if unit.si == "rad" else 0.0
    if unit_name in COUNTS:
        gain /= _counts(what, unit_name, given)
    elif "counts_per_rev" in given:
        raise RecordError(
            f"{what} has counts_per_rev, which is for the units {' and '.join(COUNTS)}, got the "
            f"unit {unit_name!r}. Write the unit, or leave counts_per_rev out."
        )
    geared = _gear(what, given, unit.si, n)
    if given.get("time_unit") is not None:
        unit_of("t", given["time_unit"], f"time_unit of {what}")
    return ColumnSource(
        source=given.get("source", name),
        log_unit=unit_name,
        unit=unit.si,
        gain=gain * geared,
        offset=_number(f"offset of {what}", given.get("offset", 0.0), zero=True),
        turn=turn * geared,
        time=given.get("time"),
        time_unit=given.get("time_unit"),
        samples_late=_late(what, name, given.get("samples_late", 0.0)),
    )


def _gained(what: str, name: str, given: Mapping[str, Any]) -> Unit | None:
    """Return the unit of a torque that the log has in volts or amperes; None without a gain."""
    if "gain" not in given:
        return None
    gain = given["gain"]
    if not isinstance(gain, Mapping) or set(gain) != {"value", "unit"}:
        raise RecordError(
            f'gain of {what} must look like {{ value = 0.3, unit = "N m/V" }}, got {gain!r}.'
        )
    torques = [unit for unit in column_of(name).units if unit in ("N m", "N")]
    known = [f"{torque}/{source}" for torque in torques for source in ("V", "A")]
    if gain["unit"] not in known:
        allowed = f"must be one of {', '.join(known)}" if known else "is for torques only"
        raise RecordError(f"The unit of gain of {what} {allowed}, got {gain['unit']!r}.")
    torque, source = gain["unit"].split("/")
    log = given.get("unit", source)
    if log not in UNITS or UNITS[log].si != source:
        raise RecordError(
            f"unit of {what} must be {source} or m{source}, as its gain is in {gain['unit']}, "
            f"got {log!r}."
        )
    return Unit(torque, UNITS[log].factor * _number(f"value of gain of {what}", gain["value"]))


def _number(what: str, value: object, zero: bool = False) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise RecordError(f"{what} must be a number, got {value!r}.")
    if value == 0 and not zero:
        raise RecordError(f"{what} must not be 0.")
    return float(value)


def _late(what: str, name: str, value: object) -> float:
    late = _number(f"samples_late of {what}", value, zero=True)
    if abs(late) > LATEST:
        raise RecordError(
            f"samples_late of {what} must be within {LATEST} rows either way, got {late:g}."
        )
    if name in COMMANDS and late != round(late):
        raise RecordError(
            f"samples_late of {what} must be a whole number, as a command holds its value between "
            f"rows, got {late:g}."
        )
    return late


def _sign(what: str, given: Mapping[str, Any]) -> float:
    sign = given.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise RecordError(f"sign of {what} must be 1 or -1, got {sign!r}.")
    return float(sign)


def _counts(what: str, unit: str, given: Mapping[str, Any]) -> float:
    if "counts_per_rev" not in given:
        raise RecordError(
            f"{what} has the unit {unit!r} and needs  counts_per_rev = ...  (counts of the encoder "
            "per revolution)."
        )
    return _number(f"counts_per_rev of {what}", given["counts_per_rev"])


def _gear(what: str, given: Mapping[str, Any], si: str, n: float | None) -> float:
    side = given.get("side", "link")
    if side not in SIDES:
        raise RecordError(f"side of {what} must be 'link' or 'motor', got {side!r}.")
    if side == "link":
        return 1.0
    if si not in GEARED:
        raise RecordError(
            f"side of {what} says 'motor', which is for angles, velocities and torques of rotary "
            f"joints; this column has the unit {si!r}. Leave it out."
        )
    if n is None:
        raise RecordError(
            f"{what} is on the motor's side and needs the gear ratio: a line  n = ...  at the top, "
            'or  joint = "..."  with a joint that has n, or --joint where a command takes it.'
        )
    return float(n ** GEARED[si])
