"""`cjt-gym check`: what a record can and cannot tell, before any fit."""

from __future__ import annotations

import argparse
import sys

from cjt_gym.console import Answer
from cjt_gym.errors import MissingFileError, UnknownNameError
from cjt_gym.gap.check import Examination, examine
from cjt_gym.gap.check.text import text
from cjt_gym.gap.report import WIDTH
from cjt_gym.joint import STRUCTURES, JointFile, get_structure, load_joint_file
from cjt_gym.records import Record, read_log, record_names

NOMINAL = "nominal.toml"


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
    """Examine the record and print what it tells."""
    structure = None if options.structure is None else get_structure(options.structure)
    records, _ = read_log(options.record, options.mapping)
    found = examine(records, _joint(records[0], options.joint), structure)
    return to_json(found), text(found, WIDTH)


def to_json(found: Examination) -> dict[str, object]:
    """Return an examination with all that the terminal shows."""
    return found.to_dict() | {
        "smallest": {
            name: {"value": x, "unit": unit} for name, (x, unit) in found.smallest.items()
        },
        "advice": list(found.advice),
        "channels": [channel.to_dict() for channel in found.channels.values()],
    }


def _joint(record: Record, given: str | None) -> JointFile | None:
    """Return the nominal joint that was given or is found beside the record; None without one."""
    if given is not None:
        return load_joint_file(given)
    if record.joint_file is not None:
        try:
            return load_joint_file(record.joint_file)
        except (MissingFileError, UnknownNameError) as error:
            sys.stderr.write(f"cjt-gym: examined without a joint. {error}\n")
            return None
    if record.origin is not None and (beside := record.origin.parent / NOMINAL).is_file():
        return load_joint_file(beside)
    return None
