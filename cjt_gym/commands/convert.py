"""`cjt-gym convert`: logs and traces into records, and records into other formats."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cjt_gym.records import FORMATS, Record, Repair, one_joint, read_log, write_record


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to read, how to understand it, and where to write it."""
    add = parser.add_argument
    add("log", metavar="LOG", help=f"a record or a log ({', '.join(FORMATS)})")
    text = "which column is which: a TOML file; default: LOG's name with .map.toml, beside it"
    add("--mapping", metavar="FILE.toml", help=text)
    text = "configuration of a joint, as for hardware: LOG is a trace of its bus, read by the "
    text += "protocols of its nodes"
    add("--bus", metavar="CONFIG.toml", help=text)
    add("--joint", metavar="NAME", help="the joint of which LOG, or the configuration, has several")
    endings = ", ".join(ending for ending, form in FORMATS.items() if form.write is not None)
    add("--out", type=Path, required=True, metavar="RECORD", help=f"file to write ({endings})")


def run(options: argparse.Namespace) -> None:
    """Read, repair, write, and say what was repaired."""
    records, repairs = _read(options)
    paths = [
        write_record(record, _numbered(options.out, k, len(records)))
        for k, record in enumerate(records)
    ]
    if options.json:
        written = [
            {"record": str(path), "samples": len(record), "columns": list(record.columns)}
            for path, record in zip(paths, records, strict=True)
        ]
        result = {"records": written, "repairs": [str(repair) for repair in repairs]}
        sys.stdout.write(json.dumps(result) + "\n")
        return
    for repair in repairs:
        sys.stderr.write(f"{repair}\n")
    for path, record in zip(paths, records, strict=True):
        sys.stdout.write(f"{path}: {len(record)} samples of {', '.join(record.columns)}\n")


def _read(options: argparse.Namespace) -> tuple[tuple[Record, ...], tuple[Repair, ...]]:
    if options.bus is None:
        records, repairs = read_log(options.log, options.mapping)
        if options.joint is not None:
            records = tuple(one_joint(record, options.joint) for record in records)
        return records, repairs
    from cjt_gym.canbus.config import load_hardware
    from cjt_gym.canbus.protocols import protocol_of
    from cjt_gym.canbus.traces import read_trace

    config = load_hardware(options.bus, options.joint)
    nodes = [(protocol_of(node.protocol), node.settings) for node in config.nodes]
    joint = config.joint
    return read_trace(options.log, nodes, joint=joint.parameters.name, structure=joint.structure)


def _numbered(path: Path, k: int, count: int) -> Path:
    """Return the name of a piece of a log that was cut."""
    return path if count == 1 else path.with_stem(f"{path.stem}_{k + 1}")
