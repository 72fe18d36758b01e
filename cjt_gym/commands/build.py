"""`cjt-gym build`: many joints from one table."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from cjt_gym.console import Answer
from cjt_gym.disk import check_file_name, write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import Joint, to_toml
from cjt_gym.joint.build import build_joints, file_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the table and where its joints are written."""
    text = "TOML file with joints, structures, drives and effects; see help(cjt_gym.joint.build)"
    parser.add_argument("table", metavar="TABLE", help=text)
    text = "folder for one joint file per joint; default: they are only listed"
    parser.add_argument("--out", type=Path, metavar="DIR", help=text)


def run(options: argparse.Namespace) -> Answer:
    """List the joints of the table, and write them."""
    rows, lines = [], []
    joints = build_joints(options.table)
    paths = {} if options.out is None else _written(joints, options.out, options.table)
    for name, joint in joints.items():
        lines.append(f"{name}  {', '.join(joint.effects) or 'no effects'}\n")
        rows.append(
            {
                "name": name,
                "structure": joint.structure,
                "drive": joint.drive,
                "effects": list(joint.effects),
                "file": str(paths[name]) if paths else None,
            }
        )
    return {"joints": rows}, "".join(lines)


def _written(joints: Mapping[str, Joint], folder: Path, table: str) -> dict[str, Path]:
    """Write one file per joint, after checking that all can be written; return their paths."""
    for name in joints:
        check_file_name(name, f"The name of a joint of {table}")
    paths = {name: folder / f"{name}.toml" for name in joints}
    texts = {name: to_toml(file_of(joint)) for name, joint in joints.items()}
    for name, path in paths.items():
        if path.exists() and path.read_bytes() != texts[name].encode("utf-8"):
            raise ConfigurationError(
                f"{path} exists and differs from what the table says. Give another --out, or "
                "move that file away."
            )
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in paths.items():
        write_text(path, texts[name])
    return paths
