"""Records in files: a table in one of :data:`FORMATS`, and the TOML file beside it."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.disk import whole
from cjt_gym.errors import RecordError, check_type, unknown_name
from cjt_gym.records.formats import FORMATS, Table, format_of, writer_of
from cjt_gym.records.mapping import SUFFIX, ColumnMapping, load_mapping, read_document
from cjt_gym.records.metadata import describes_record, facts_path, metadata_text, read_metadata
from cjt_gym.records.record import JOINT_FILE, Record, joint_to_load, missing_joint
from cjt_gym.records.sources import aligned, clock, mapped

MappingLike = str | Path | Mapping[str, Any]
ROWS = 100_000
"""Rows of a table that are read at a time."""
NOMINAL = "nominal.toml"
"""Joint file beside a log that names no joint."""


def read_record(
    path_or_name: str | Path,
    allow_nan: bool = False,
    mapping: MappingLike | None = None,
    n: float | None = None,
) -> Record:
    """Read a record from its table or the ``.toml`` beside it, or a shipped one by its name.

    Nothing is repaired: a log that is not in order is an error. See
    :func:`cjt_gym.records.read_log` for such ones.

    Args:
        path_or_name: A table in one of :data:`FORMATS`, such as ``run.csv``, or ``run.toml``, or
            one of :func:`record_names`.
        allow_nan: Whether NaN (an empty cell of a CSV file) marks a missing sample.
        mapping: Which column is which, in which unit, where the table has other names: a TOML file
            or the same as dictionaries, see :mod:`cjt_gym.records.mapping`. Left out, the file
            ``run.map.toml`` beside the table counts, if there is one.
        n: Gear ratio, used where the mapping gives none; by default that of the joint it names.

    Raises:
        RecordError: There is no such record, or its files are not valid.

    Example:
        >>> record = read_record("emps")
        >>> len(record), record.units["q_m"]
        (24841, 'm')
    """
    path = table_path(path_or_name)
    chosen = mapping_of(path, mapping, n)
    if chosen is None:
        facts = read_metadata(path.with_suffix(".toml"))
        columns = format_of(path).read(path)
    else:
        content = joined(format_of(path).stream(path, ROWS))
        columns = mapped(chosen, content, clock(chosen, content, str(path)), str(path))
        columns = joined(aligned([columns], chosen.late))
        facts = facts_of(path, chosen)
        facts["units"] = {name: facts["units"].get(name, "s") for name in columns}
    return Record(columns=columns, allow_nan=allow_nan, origin=path, **facts)


def is_record(path_or_name: str | Path) -> bool:
    """Return whether a table is a record: its metadata stand beside it, and no mapping does."""
    path = table_path(path_or_name)
    return _given_or_beside(path, None) is None and describes_record(path.with_suffix(".toml"))


def joined(pieces: Iterable[Table]) -> dict[str, NDArray[Any]]:
    """Return the pieces of a table as one."""
    all_pieces = list(pieces)
    names = list(dict.fromkeys(name for piece in all_pieces for name in piece))
    return {
        name: np.concatenate([piece[name] for piece in all_pieces if name in piece])
        for name in names
    }


def mapping_of(
    path: Path, mapping: MappingLike | None, n: float | None = None
) -> ColumnMapping | None:
    """Return the mapping that was given, or else the one beside a table, or else None."""
    found = _given_or_beside(path, mapping)
    if found is None:
        return None
    try:
        return load_mapping(found, gear_ratio_of(path, mapping) if n is None else n)
    except RecordError as error:
        named = read_document(found).get("joint")
        missing = missing_joint(named, None, path) if isinstance(named, str) else ""
        if missing:
            raise RecordError(f"{error} {missing}") from None
        raise


def gear_ratio_of(path_or_name: str | Path, mapping: MappingLike | None = None) -> float | None:
    """Return the gear ratio of the joint that a log names, if its TOML file is at hand and has one.

    Arguments and errors are those of `joint_of`.
    """
    joint = joint_of(path_or_name, mapping)
    if joint is None:
        return None
    shipped = Path(str(resources.files("cjt_gym.params")))
    path = Path(joint) if Path(joint).suffix else shipped / f"{joint}.toml"
    if path.suffix != ".toml" or not path.is_file():
        return None
    try:
        entry = tomllib.loads(path.read_text(encoding="utf-8"))["parameters"]["n"]["value"]
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, KeyError, TypeError):
        return None  # who loads the joint says what is wrong with it
    return float(entry) if isinstance(entry, int | float) and entry > 0.0 else None


def joint_of(path_or_name: str | Path, mapping: MappingLike | None = None) -> str | Path | None:
    """Return the joint to load for a log: the one it names, or else nominal.toml beside it.

    A joint that does not ship is found by its file: see `joint_to_load`.

    Args:
        path_or_name: The log, which is not read itself.
        mapping: Which column is which; see :func:`read_record`.

    Raises:
        RecordError: There is no such log, or the files that describe it are not valid.
    """
    path = table_path(path_or_name)
    found, beside = _given_or_beside(path, mapping), path.with_suffix(".toml")
    facts = {} if found is None else read_document(found)
    if describes_record(beside):
        facts |= read_metadata(beside)
    named = facts.get("joint")
    if isinstance(named, str):
        return joint_to_load(named, facts.get("provenance", {}).get(JOINT_FILE), path)
    nominal = path.with_name(NOMINAL)
    return nominal if nominal.is_file() else None


def _given_or_beside(path: Path, mapping: MappingLike | None) -> MappingLike | None:
    beside = path.with_suffix(SUFFIX)
    converted = path.suffix == ".npz" and describes_record(path.with_suffix(".toml"))
    return beside if mapping is None and beside.is_file() and not converted else mapping


def facts_of(path: Path, mapping: ColumnMapping) -> dict[str, Any]:
    """Return what is known of a mapped table: from the mapping, and the ``.toml`` beside it."""
    beside = path.with_suffix(".toml")
    facts = read_metadata(beside) if describes_record(beside) else {}
    tables = {
        name: {**mapping.facts[name], **facts.get(name, {})} for name in ("sensors", "provenance")
    }
    return {**mapping.facts, **facts, **tables, "units": mapping.units}


def write_record(record: Record, path: str | Path) -> Path:
    """Write a record as a table, its format given by the suffix, and the ``.toml`` beside it.

    Both appear whole or not at all.

    Returns:
        Path of the table.

    Raises:
        RecordError: The suffix is not one of :data:`FORMATS`, or one that is only read, or the
            ``.toml`` is there and of something else.
    """
    check_type("record", record, Record, "a Record")
    check_type("path", path, (str, os.PathLike), "the path of the file to write")
    path = Path(path)
    write = writer_of(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole(facts_path(path)) as facts, whole(path) as table:
        write({name: record[name] for name in record.columns}, table)
        facts.write_text(metadata_text(record), encoding="utf-8")
    return path


def record_names() -> tuple[str, ...]:
    """Return the names of the records that ship with the package."""
    return tuple(
        sorted(
            entry.name.removesuffix(".npz")
            for entry in _shipped().iterdir()
            if entry.name.endswith(".npz")
        )
    )


def _shipped() -> Path:
    return Path(str(resources.files("cjt_gym.records"))) / "data"


def table_path(path_or_name: str | Path) -> Path:
    """Return the path of a table, of the one a ``.toml`` belongs to, or of a shipped record."""
    if not isinstance(path_or_name, str | os.PathLike):
        raise RecordError(
            f"A log is named by its path, or by the name of a shipped record, got {path_or_name!r}."
        )
    if str(path_or_name) in record_names():
        return _shipped() / f"{path_or_name}.npz"
    path = Path(path_or_name)
    if path.suffix == ".toml":
        return _table_beside(path)
    if os.path.isfile(path):
        return path
    if os.path.isdir(path):
        raise RecordError(f"{path} is a folder. Name a log or a record in it.")
    hint = unknown_name("record", str(path_or_name), record_names())
    raise RecordError(f"There is no file {path}. {hint}")


def _table_beside(path: Path) -> Path:
    tables = [table for suffix in FORMATS if os.path.isfile(table := path.with_suffix(suffix))]
    if len(tables) != 1:
        found = ", ".join(table.name for table in tables) or "none"
        raise RecordError(
            f"Beside {path} there must be exactly one table ({', '.join(FORMATS)}), found {found}. "
            "Name the table."
        )
    return tables[0]
