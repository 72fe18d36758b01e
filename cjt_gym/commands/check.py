"""`cjt-gym check`: what a record can and cannot tell, before any fit."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from cjt_gym.console import Answer
from cjt_gym.errors import MissingFileError, UnknownNameError
from cjt_gym.gap.check import Examination, examination_of
from cjt_gym.joint import STRUCTURES, JointFile, get_structure, load_joint_file
from cjt_gym.records import joint_of, read_log, record_names
from cjt_gym.records.files import NOMINAL


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what was recorded, and of what."""
    add = parser.add_argument
    shipped = ", ".join(record_names())
    add("record", metavar="RECORD", help=f"a file, or a record that ships: {shipped}")
    words = f"nominal joint: a name or a file; default: what the record names, or {NOMINAL} beside "
    add("--joint", metavar="JOINT|FILE.toml", help=words + "it; without one, sizes are in amperes")
    add("--structure", metavar="S", help=f"{', '.join(STRUCTURES)}; default: what the record says")
    add("--mapping", metavar="FILE", help="TOML file that says which column is what, in which unit")


def run(options: argparse.Namespace) -> Answer:
    """Examine the record and print what it can tell."""
    structure = None if options.structure is None else get_structure(options.structure)
    joint = _joint(options)
    n = None if joint is None else joint.gear_ratio
    records, repairs = read_log(options.record, options.mapping, n=n)
    found = examination_of(records, joint, structure)
    known = {*found.faults, *found.notes}
    taken = (r.text for r in repairs if r.kind == "unit" and r.text not in known)
    cut = tuple(r.text for r in repairs if r.kind == "cut" and r.text not in known)
    found = replace(found, notes=(*found.notes, *taken), faults=(*cut, *found.faults))
    return to_json(found), str(found)


def to_json(found: Examination) -> dict[str, object]:
    """Return an examination with all that the terminal shows."""
    return found.to_dict() | {
        "smallest": {
            name: {"value": x, "unit": unit} for name, (x, unit) in found.smallest.items()
        },
        "advice": list(found.advice),
        "channels": [channel.to_dict() for channel in found.channels.values()],
    }


def _joint(options: argparse.Namespace) -> JointFile | None:
    """Return the nominal joint that was given or that the record names; None without one."""
    if options.joint is not None:
        return load_joint_file(options.joint)
    named = joint_of(options.record, options.mapping)
    try:
        return None if named is None else load_joint_file(named)
    except (MissingFileError, UnknownNameError) as error:
        sys.stderr.write(f"cjt-gym: examined without a joint. {error}\n")
        return None
