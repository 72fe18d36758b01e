"""`cjt-gym convert`: logs and traces into records, records into other formats, joints into TOML."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from cjt_gym.console import Answer
from cjt_gym.disk import refuse_inputs, write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import to_toml
from cjt_gym.joint.files.joint_file import TOOLBOX_SUFFIX
from cjt_gym.joint.files.toolbox_files import read_toolbox
from cjt_gym.records import (
    FORMATS,
    Record,
    Repair,
    draft_mapping,
    one_joint,
    read_log,
    write_record,
)
from cjt_gym.records.draft import UNKNOWN
from cjt_gym.records.files import table_path
from cjt_gym.records.mapping import SUFFIX


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to read, how to understand it, and where to write it."""
    add = parser.add_argument
    text = f"a record or a log ({', '.join(FORMATS)}), or a parameter file of the toolbox "
    add("log", metavar="LOG|JOINT.m", help=f"{text}({TOOLBOX_SUFFIX})")
    text = "which column is which: a TOML file; default: LOG's name with .map.toml, beside it"
    add("--mapping", metavar="FILE.toml", help=text)
    text = "configuration of a joint, as for hardware: LOG is a trace of its bus, read by the "
    text += "protocols of its nodes"
    add("--bus", metavar="CONFIG.toml", help=text)
    text = "joint from which comes what JOINT.m leaves open; generic has the toolbox's defaults"
    add("--defaults", metavar="JOINT", help=text)
    add("--joint", metavar="NAME", help="the joint of which LOG, or the configuration, has several")
    text = f"file to write ({_endings()}; .toml for a joint; {SUFFIX} for a draft of LOG's mapping)"
    add("--out", type=Path, required=True, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Read, repair, write, and say what was repaired."""
    if Path(options.log).suffix == TOOLBOX_SUFFIX:
        return _write_joint(options)
    if options.out.name.endswith(SUFFIX):
        return _write_draft(options)
    if options.out.suffix == ".toml":
        raise ConfigurationError(
            f"--out of a log must be a record ({_endings()}) or, for a draft of its mapping, end "
            f"in {SUFFIX}, got {options.out}."
        )
    if options.defaults is not None:
        raise ConfigurationError(f"--defaults is for a joint (.m), got the log {options.log}.")
    records, repairs = _read(options)
    paths = [_numbered(options.out, k, len(records)) for k in range(len(records))]
    refuse_inputs(paths, [table_path(options.log), options.log, options.mapping, options.bus])
    for record, path in zip(records, paths, strict=True):
        write_record(record, path)
    if not options.json:
        sys.stderr.writelines(f"{repair}\n" for repair in repairs)
    written: list[dict[str, Any]] = [
        {"record": str(path), "samples": len(record), "columns": list(record.columns)}
        for path, record in zip(paths, records, strict=True)
    ]
    lines = [f"{w['record']}: {w['samples']} samples of {', '.join(w['columns'])}" for w in written]
    return {"records": written, "repairs": [str(repair) for repair in repairs]}, "\n".join(lines)


def _endings() -> str:
    return ", ".join(ending for ending, form in FORMATS.items() if form.write is not None)


def _write_joint(options: argparse.Namespace) -> Answer:
    for name in ("bus", "joint", "mapping"):
        if getattr(options, name) is not None:
            raise ConfigurationError(
                f"--{name} is for a log, got the joint {options.log}, which has one name and no "
                "bus. Leave it out."
            )
    if options.out.suffix != ".toml":
        raise ConfigurationError(f"--out of a joint must end in .toml, got {options.out}.")
    file = read_toolbox(options.log, options.defaults)
    refuse_inputs([options.out], [options.log, options.defaults])
    write_text(options.out, to_toml(file))
    count = len(file.parameters.quantities)
    return {"joint": str(options.out), "parameters": count}, f"{options.out}: {count} parameters"


def _write_draft(options: argparse.Namespace) -> Answer:
    if options.out.exists():
        raise ConfigurationError(f"{options.out} exists. Give another --out, or move it away.")
    text = draft_mapping(options.log)
    write_text(options.out, text)
    told = f'{options.out}: a draft. Check every guess and replace every "{UNKNOWN}" in it.'
    return {"mapping": str(options.out), "text": text}, told


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
    return path if count == 1 else path.with_stem(f"{path.stem}_{k + 1}")
