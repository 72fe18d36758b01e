"""Many joints from one table: parameter sets times structures times drives times effects.

The table is a TOML file:

    structures = ["rigid_gearbox", "output_fixed_rigid_gearbox"]
    drives = ["current"]

    [joints]
    plain = { file = "orange_80_6000" }
    stiff = { file = "orange_80_6000", parameters = { k_b = 12000.0 } }

    [effects]
    smooth = {}
    rough = { coulomb = { dq_0 = 0.002 }, cogging = { f = [480.0], a = [0.5], b = [0.2] } }

It describes eight joints, with names such as ``stiff-rigid_gearbox-rough``. The drive is part of
the name if there are several. Without `structures`, `drives` or `effects` a joint has what its own
file says, as `load_joint` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from cjt_gym.disk import read_toml
from cjt_gym.errors import CjtGymError, ConfigurationError, MissingFileError, unknown_key
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.files.effect_entries import unit_on
from cjt_gym.joint.files.joint_file import JointFile, is_path
from cjt_gym.joint.files.parameters import SET_IN_PYTHON
from cjt_gym.joint.files.quantity import FrozenMapping, Quantity, Setting
from cjt_gym.joint.joint import Joint, load_joint

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
        try:
            table = read_toml(Path(table), ConfigurationError)
        except FileNotFoundError:
            raise MissingFileError(f"The table of joints {owner} does not exist.") from None
    _check_keys(table, KEYS, owner)
    if not table.get("joints"):
        raise ConfigurationError(f"{owner} must have 'joints', got none. Add at least one.")
    structures, drives = (_names(table, key, owner) for key in ("structures", "drives"))
    effects: Mapping[str, Any] = table.get("effects") or {"": None}
    for key, rows in (("joints", table["joints"]), ("effects", effects)):
        if not isinstance(rows, Mapping):
            raise ConfigurationError(f"{key} of {owner} must be a table, got {rows!r}.")
    found: dict[str, Joint] = {}
    sets = table["joints"].items()
    for (name, row), structure, drive, kind in product(sets, structures, drives, effects):
        _check_keys(row, JOINT_KEYS, f"joint {name} of {owner}")
        file, parameters = row.get("file", name), row.get("parameters", {})
        if not isinstance(file, str) or not isinstance(parameters, Mapping):
            raise ConfigurationError(
                f"file of joint {name} of {owner} must be a name or a path, and parameters a table "
                f"such as {{ k_b = 3e3 }}, got {file!r} and {parameters!r}."
            )
        label = "-".join(filter(None, [name, structure, drive if len(drives) > 1 else "", kind]))
        place = folder / Path(file).expanduser() if is_path(file) else file
        try:
            joint = load_joint(place, structure, drive, effects[kind], parameters)
        except CjtGymError as error:
            raise type(error)(f"{label} of {owner}: {error}") from None
        named = replace(joint.parameters, name=label, quantities=_sourced(joint, owner))
        found[label] = replace(joint, file=replace(joint.file, parameters=named))
    return found


def file_of(joint: Joint) -> JointFile:
    """Return a joint file that loads as this joint: its structure, drive and active effects."""
    p = joint.parameters
    tables: dict[str, Mapping[str, Setting]] = {}
    for name, values in joint.effects.items():
        units = {row.symbol: unit_on(row, p) for row in EFFECTS[name].parameters}
        tables[name] = FrozenMapping(
            {key: Quantity(value, units[key], "set in a table") for key, value in values.items()}
        )
    return replace(
        joint.file,
        effects=FrozenMapping(tables),
        structure=joint.structure,
        drive=joint.drive,
    )


def _names(table: Mapping[str, Any], key: str, owner: str) -> list[str | None]:
    """Return the names of a list in the table; where it has none, one that is left to the file."""
    if key not in table:
        return [None]
    names = table[key]
    if not isinstance(names, list | tuple) or not names or {type(n) for n in names} != {str}:
        raise ConfigurationError(f"{key} of {owner} must be a list of names, got {names!r}.")
    return list(names)


def _sourced(joint: Joint, owner: str) -> dict[str, Quantity]:
    """Return the joint's parameters; those that the table replaced say so."""
    return {
        symbol: replace(row, source=f"set in {owner}") if row.source == SET_IN_PYTHON else row
        for symbol, row in joint.parameters.quantities.items()
    }


def _check_keys(row: object, known: tuple[str, ...], owner: str) -> None:
    if not isinstance(row, Mapping):
        raise ConfigurationError(f"{owner} must be a table with {', '.join(known)}, got {row!r}.")
    for key in row:
        if key not in known:
            raise ConfigurationError(unknown_key(owner, key, known))
