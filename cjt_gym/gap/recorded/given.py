"""The records, the joint and the structure that a caller gives, as the diagnosis takes them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cjt_gym.errors import ConfigurationError, MissingFileError, check_type
from cjt_gym.gap.recorded.fields import check_bodies
from cjt_gym.joint import Joint, JointFile, Structure, get_structure, load_joint_file
from cjt_gym.joint.build import file_of
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.records import Record

JointLike = str | Path | Joint | JointFile
"""A joint: its name, the path of its file, or the loaded one."""


def as_records(records: object, taker: str) -> list[Record]:
    """Return the records as a list, or refuse what is none.

    Args:
        records: What was given.
        taker: Name of the function that takes them.

    Raises:
        ConfigurationError: Something is no record; the message says how to get one.
    """
    if isinstance(records, Record):
        return [records]
    found: list[object] = list(records) if isinstance(records, Iterable) else [records]
    taken: list[Record] = []
    for record in found:
        if isinstance(record, list | tuple):
            raise ConfigurationError(
                f"{taker} takes records, got what read_log returns: records and repairs. Write "
                f"records, repairs = read_log(...), and give {taker} the records."
            )
        if not isinstance(record, Record):
            got = "None" if record is None else f"a {type(record).__name__}"
            raise ConfigurationError(
                f"{taker} takes records of type Record, got {got}. "
                "Read a file with cjt_gym.records.read_record."
            )
        taken.append(record)
    return taken


def joint_file_of(joint: JointLike) -> JointFile:
    """Return the file of a joint; effects that a `Joint` has beside its file are written into it.

    Raises:
        CjtGymError: There is no such joint, or its file is not valid.
    """
    if isinstance(joint, JointFile):
        return joint
    if isinstance(joint, Joint):
        own = resolve_effects(None, joint.file, joint.structure_row, joint.drive)
        return joint.file if joint.effects == own else file_of(joint)
    return load_joint_file(joint)


def named_joint(record: Record) -> JointFile | None:
    """Return the joint file that a record names; None where it names none.

    Raises:
        CjtGymError: It does not exist, or is not valid.
    """
    if missing := record.missing_joint:
        raise MissingFileError(
            f"{record.owner} names a joint that is not there. {missing} Give the joint."
        )
    return None if record.joint_file is None else joint_file_of(record.joint_file)


def structure_of(structure: str | Structure) -> Structure:
    """Return a structure by name, or as it is."""
    if isinstance(structure, Structure):
        return structure
    check_type("structure", structure, str, "the name of a structure")
    return get_structure(structure)


def nominal_joint(
    record: Record, joint: JointLike | None, structure: str | Structure | None
) -> tuple[JointFile, Structure]:
    """Return the nominal joint and its structure, given or named by the record.

    Raises:
        CjtGymError: One of them is unknown or missing, or the joint does not suit the structure.
    """
    file = named_joint(record) if joint is None else joint_file_of(joint)
    if file is None:
        raise ConfigurationError(
            f"{record.owner} names no joint. Give the nominal joint: a name, a file or a Joint."
        )
    if isinstance(joint, Joint):
        return file, structure_of(structure or joint.structure)
    name = structure or record.structure or file.structure
    if name is None:
        raise ConfigurationError(
            f"{record.owner} names no structure. Give one, such as structure='output_fixed'."
        )
    shape = structure_of(name)
    check_bodies(file.parameters, shape)
    return file, shape
