"""Many joints from one table: parameter sets times structures times drives times effects.

The table is a TOML file:

    structures = ["rigid_gearbox", "output_fixed_rigid_gearbox"]
    drives = ["current"]                          # this is the default

    [joints]
    plain = { file = "orange_80_6000" }
    stiff = { file = "orange_80_6000", parameters = { k_b = 12000.0 } }

    [effects]
    smooth = {}
    rough = { coulomb = { dq_0 = 0.002 }, cogging = { f = [480.0], a = [0.5], b = [0.2] } }

It describes eight joints, with names such as ``stiff-rigid_gearbox-rough``. The drive is part of
the name if there are several.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from cjt_gym.disk import read_toml
from cjt_gym.errors import ConfigurationError, MissingFileError, did_you_mean
from cjt_gym.joint.effect_entries import unit_on
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.files import JointFile
from cjt_gym.joint.joint import Joint, load_joint
from cjt_gym.joint.quantity import FrozenMapping, Quantity, Setting

KEYS = ("joints", "structures", "drives", "effects")
JOINT_KEYS = ("file", "parameters")


def build_joints(table: str | Path | Mapping[str, Any]) -> dict[str, Joint]:
    """Return the joints of a table by name.

    Args:
        table: Path of a TOML file, or the same as a mapping. Paths of joint files in it are
            relative to the table.

    Raises:
        MissingFileError: There is no such table.
        ConfigurationError: A key is unknown or missing, or the file is no TOML.
        UnknownNameError, ParameterError: As for `load_joint`; an effect that cannot act in one of
            the structures is an error.

    Example:
        >>> table = {"joints": {"soft": {"file": "orange_80_6000", "parameters": {"k_b": 3e3}}},
        ...          "structures": ["rigid", "output_fixed"]}
        >>> list(build_joints(table))
        ['soft-rigid', 'soft-output_fixed']
    """
    folder, owner = Path(), "the table"
    if not isinstance(table, Mapping):
        folder, owner = Path(table).parent, str(table)
        table = _read(Path(table))
    _check_keys(table, KEYS, owner)
    for key in ("joints", "structures"):
        if not table.get(key):
            raise ConfigurationError(f"{owner} must have '{key}', got none. Add at least one.")
    drives = table.get("drives", ["current"])
    effects: Mapping[str, Any] = table.get("effects") or {"": None}
    for key, names in (("structures", table["structures"]), ("drives", drives)):
        if not isinstance(names, list | tuple) or not all(isinstance(n, str) for n in names):
            raise ConfigurationError(f"{key} of {owner} must be a list of names, got {names!r}.")
    for key, rows in (("joints", table["joints"]), ("effects", effects)):
        if not isinstance(rows, Mapping):
            raise ConfigurationError(f"{key} of {owner} must be a table, got {rows!r}.")
    found: dict[str, Joint] = {}
    sets = table["joints"].items()
    for (name, row), structure, drive, kind in product(sets, table["structures"], drives, effects):
        _check_keys(row, JOINT_KEYS, f"joint {name} of {owner}")
        file, parameters = row.get("file", name), row.get("parameters", {})
        if not isinstance(file, str) or not isinstance(parameters, Mapping):
            raise ConfigurationError(
                f"file of joint {name} of {owner} must be a name or a path, and parameters a table "
                f"such as {{ k_b = 3e3 }}, got {file!r} and {parameters!r}."
            )
        parts = [name, structure, drive if len(drives) > 1 else "", kind]
        label = "-".join(part for part in parts if part)
        joint = load_joint(
            _located(file, folder),
            structure,
            drive,
            effects[kind],
            parameters,
        )
        named = replace(joint.parameters, name=label)
        found[label] = replace(joint, file=replace(joint.file, parameters=named))
    return found


def file_of(joint: Joint) -> JointFile:
    """Return a joint file that loads as this joint: its structure, drive and active effects."""
    p = joint.parameters
    tables: dict[str, Mapping[str, Setting]] = {}
    for name, values in joint.effects.items():
        entries: dict[str, Setting] = {}
        for symbol, value in values.items():
            row = EFFECTS[name].parameter(symbol)
            if row is None:
                entries[symbol] = value  # type: ignore[assignment]
            else:
                entries[symbol] = Quantity(value, unit_on(row, p), "set in a table")
        tables[name] = FrozenMapping(entries)
    return replace(
        joint.file,
        effects=FrozenMapping(tables),
        structure=joint.structure,
        drive=joint.drive,
    )


def _read(path: Path) -> Mapping[str, Any]:
    try:
        return read_toml(path, ConfigurationError)
    except FileNotFoundError:
        raise MissingFileError(f"The table of joints {path} does not exist.") from None


def _check_keys(row: object, known: tuple[str, ...], owner: str) -> None:
    if not isinstance(row, Mapping):
        raise ConfigurationError(f"{owner} must be a table with {', '.join(known)}, got {row!r}.")
    for key in row:
        if key not in known:
            raise ConfigurationError(
                f"{owner} has the unknown key '{key}'.{did_you_mean(key, known)} Known: "
                f"{', '.join(known)}."
            )


def _located(file: str, folder: Path) -> str | Path:
    """Return the name of a shipped joint, or the path of a file beside the table."""
    return folder / file if file.endswith(".toml") else file
