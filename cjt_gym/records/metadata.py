"""The TOML file beside a record's table: its units, its sample time, and what is known of it."""

from __future__ import annotations

import datetime
import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from cjt_gym.disk import Inline, read_toml, to_toml, write_text
from cjt_gym.errors import RecordError, unknown_name
from cjt_gym.records.columns import default_units
from cjt_gym.records.record import JOINT_FILE, Record

SCALARS: Final[dict[str, tuple[type, ...]]] = {
    "dt": (float, int),
    "seed": (int,),
    "parameter_hash": (str,),
    "joint": (str,),
    "structure": (str,),
}
TABLES: Final = ("units", "versions", "sensors", "provenance")
PLAIN_PROVENANCE: Final = (JOINT_FILE, "mode", "excitation", "output")
"""Facts of the provenance that stand at the top of the file, where a reader looks first."""
QUANTITY_KEYS: Final = ("value", "unit", "source", "tolerance")


@dataclass(frozen=True)
class SensorQuantity:
    """A sensor property as the file gives it, in the unit of its channel."""

    value: float
    unit: str


def describes_record(path: Path) -> bool:
    """Return whether a file beside a table belongs to it: it is there and is not a joint file."""
    return path.is_file() and not _keys(path) >= {"parameters"}


def read_metadata(path: Path) -> dict[str, Any]:
    """Return the facts of a record file as keyword arguments of :class:`Record`.

    Facts without a field of their own go to ``provenance``.

    Raises:
        RecordError: The file is absent or is not TOML, has a key that looks like a misspelt one, or
            a value of a wrong type.
    """
    return checked_facts(str(path), _parse(path))


def checked_facts(owner: str, facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts of a record, out of a document, as keyword arguments of :class:`Record`."""
    known = (*SCALARS, *TABLES)
    for key in facts:
        _refuse_misspelt(owner, key, facts, known)
    for key, types in SCALARS.items():
        _check_type(owner, key, facts.get(key), types)
    for key in TABLES:
        _check_type(owner, key, facts.get(key), (dict,))
    result = {key: facts[key] for key in (*SCALARS, "units", "versions") if key in facts}
    result.setdefault("units", {})
    result["sensors"] = _sensors(owner, facts.get("sensors", {}))
    result["provenance"] = facts.get("provenance", {}) | {
        key: value for key, value in facts.items() if key not in known
    }
    return result


def write_metadata(record: Record, path: Path) -> None:
    """Write what is known of a record, whole or not at all."""
    write_text(path, metadata_text(record))


def facts_path(table: Path) -> Path:
    """Return the path of the TOML file beside a table that is to be written."""
    path = table.with_suffix(".toml")
    if path.exists() and not _keys(path) >= {"dt", "units"}:
        raise RecordError(
            f"The record {table} needs the file {path} beside it, which is there and belongs to "
            "no record. Give the record another name."
        )
    return path


def _keys(path: Path) -> set[str]:
    """Return what stands at the top of a TOML file; nothing if it cannot be read."""
    try:
        return set(read_toml(path, RecordError))
    except RecordError:
        return set()


def metadata_text(record: Record) -> str:
    """Return what is known of a record, in the layout that :func:`read_metadata` reads."""
    plain = {
        key: record.provenance[key]
        for key in PLAIN_PROVENANCE
        if isinstance(record.provenance.get(key), str)
    }
    rest = {key: value for key, value in record.provenance.items() if key not in plain}
    head = {key: getattr(record, key) for key in SCALARS} | plain
    tables = {
        "units": record.units,
        "versions": record.versions,
        "sensors": _sensor_tables(record),
        "provenance": rest,
    }
    return to_toml(
        head | {name: {k: _plain(v) for k, v in t.items()} for name, t in tables.items() if t}
    )


def _plain(value: Any) -> Any:
    """Return a value as TOML can hold it, a table on one line; what it cannot hold as a text."""
    if hasattr(value, "tolist"):  # NumPy's scalars and arrays
        value = value.tolist()
    if isinstance(value, Mapping):
        return Inline({str(key): _plain(entry) for key, entry in value.items()})
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    kept = bool | int | float | str | datetime.date | datetime.time | None
    return value if isinstance(value, kept) else str(value)


def _parse(path: Path) -> dict[str, Any]:
    if describes_record(path):
        return read_toml(path, RecordError)
    there = "; the one there is a joint file" if path.is_file() else ""
    raise RecordError(
        f"The record needs a file {path} beside its table, with the sample time dt = ... [s] "
        f'and the table [units] that gives every column its unit, such as  q_m = "rad"{there}. Or, '
        f"for a log with other names, a mapping:  cjt-gym convert LOG --out {path.stem}.map.toml"
    )


def _refuse_misspelt(
    owner: str, key: str, facts: Mapping[str, Any], known: tuple[str, ...]
) -> None:
    missing = [name for name in known if name not in facts]
    if key not in known and difflib.get_close_matches(key, missing, n=1, cutoff=0.85):
        raise RecordError(
            f"{unknown_name('key', key, known)} (in {owner}; facts of your own go under "
            "[provenance])"
        )


def _check_type(owner: str, key: str, value: object, types: tuple[type, ...]) -> None:
    if value is None or (isinstance(value, types) and not isinstance(value, bool)):
        return
    wanted = {float: "a number", int: "a whole number", str: "a string", dict: "a table"}[types[0]]
    raise RecordError(f"{key} of {owner} must be {wanted}, got {value!r}.")


def _sensors(owner: str, sensors: Mapping[str, Any]) -> dict[str, dict[str, SensorQuantity]]:
    for channel, known in sensors.items():
        _check_type(owner, f"sensors.{channel}", known, (dict,))
    return {
        channel: {
            key: _quantity(f"sensors.{channel}.{key} of {owner}", given)
            for key, given in known.items()
        }
        for channel, known in sensors.items()
    }


def _quantity(what: str, given: object) -> SensorQuantity:
    if not isinstance(given, dict) or not {"value", "unit"} <= set(given) <= set(QUANTITY_KEYS):
        raise RecordError(f'{what} must look like {{ value = 1e-6, unit = "rad" }}, got {given!r}.')
    value, unit = given["value"], given["unit"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not isinstance(unit, str):
        raise RecordError(
            f"{what} must have a number as its value and a string as its unit, got {given!r}."
        )
    return SensorQuantity(float(value), unit)


def _sensor_tables(record: Record) -> dict[str, dict[str, dict[str, object]]]:
    units = default_units(tuple(record.sensors), record.prismatic) | dict(record.units)
    return {
        channel: {key: {"value": value, "unit": units[channel]} for key, value in known.items()}
        for channel, known in record.sensors.items()
    }
