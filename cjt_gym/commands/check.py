"""`cjt-gym check`: what a record can and cannot tell, before any fit."""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace

from cjt_gym.console import Answer
from cjt_gym.errors import MissingFileError, UnknownNameError
from cjt_gym.gap.check import Examination, examine
from cjt_gym.gap.check.channels import Channel
from cjt_gym.gap.check.verdicts import sized
from cjt_gym.gap.report import WIDTH, Table
from cjt_gym.joint import EFFECTS, STRUCTURES, JointFile, get_structure, load_joint_file
from cjt_gym.records import joint_of, read_log, record_names
from cjt_gym.records.files import NOMINAL

LIMITS = frozenset({"current_saturation"})
"""Effects that show where they act at less, rather than at more, than a given size."""
NOT_TRIED = "A diagnosis does not look for any of these."
HEAD = ("channel", "unit", "from", "to", "resolution", "noise", "missing")


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
    found = examine(records, joint, structure)
    known = {*found.faults, *found.notes}
    taken = (r.text for r in repairs if r.kind == "unit" and r.text not in known)
    cut = tuple(r.text for r in repairs if r.kind == "cut" and r.text not in known)
    found = replace(found, notes=(*found.notes, *taken), faults=(*cut, *found.faults))
    return to_json(found), in_words(found, WIDTH)


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


def in_words(found: Examination, width: int) -> str:
    """Return an examination as text with lines of at most `width` characters."""
    channels = Table("Channels", "", [HEAD, *map(_row, found.channels.values())])
    sizes = [
        (name, f"{'up to ' if name in LIMITS else ''}{sized(*size)}")
        for name, size in found.smallest.items()
    ]
    parts = [channels.text(width), _list("Faults of the log", found.faults, width, "none found")]
    if found.notes:
        parts.append(_list("Remarks", found.notes, width, ""))
    if sizes:
        parts.append(Table("Identifiable", "", [("effect", "from"), *sizes]).text(width))
    else:
        parts.append("Identifiable\nnothing")
    names: dict[str, list[str]] = {}
    for row in found.cannot_tell:
        names.setdefault(row.why, []).append(row.name)
    known = {*found.can_tell, *(row.name for row in found.cannot_tell)}
    names[NOT_TRIED] = [name for name in EFFECTS if name not in known]
    reasons = [f"{', '.join(effects)}: {why}" for why, effects in names.items()]
    parts.append(_list("Not identifiable", reasons, width, "nothing"))
    parts.append(_list("What to record instead", found.advice, width, "nothing else is needed"))
    return "\n\n".join(parts)


def _list(title: str, lines: Sequence[str], width: int, none: str) -> str:
    wrapped = [
        line
        for words in lines or [none]
        for line in textwrap.wrap(words, width, initial_indent="- ", subsequent_indent="  ")
    ]
    return "\n".join([title, *wrapped])


def _row(channel: Channel) -> tuple[str, ...]:
    return (
        channel.name,
        channel.unit,
        f"{channel.low:.4g}",
        f"{channel.high:.4g}",
        f"{channel.resolution:.2g}" if channel.resolution else "-",
        f"{channel.observed:.2g}" if channel.observed else "-",
        f"{100.0 * channel.missing:.2g} %",
    )
