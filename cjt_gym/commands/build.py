"""`cjt-gym build`: many joints from one table."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cjt_gym.disk import write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import to_toml
from cjt_gym.joint.build import build_joints, file_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the table and where its joints are written."""
    text = "TOML file with joints, structures, drives and effects; see help(cjt_gym.joint.build)"
    parser.add_argument("table", metavar="TABLE", help=text)
    text = "folder for one joint file per joint; default: they are only listed"
    parser.add_argument("--out", type=Path, metavar="DIR", help=text)


def run(options: argparse.Namespace) -> None:
    """List the joints of the table, and write them."""
    rows, lines = [], []
    for name, joint in build_joints(options.table).items():
        path = None
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            path = options.out / f"{name}.toml"
            text = to_toml(file_of(joint))
            if path.exists() and path.read_text(encoding="utf-8") != text:
                raise ConfigurationError(
                    f"{path} exists and differs from what the table says. Give another --out, or "
                    "move that file away."
                )
            write_text(path, text)
        lines.append(f"{name}  {', '.join(joint.effects) or 'no effects'}\n")
        rows.append(
            {
                "name": name,
                "structure": joint.structure,
                "drive": joint.drive,
                "effects": list(joint.effects),
                "file": None if path is None else str(path),
            }
        )
    if options.json:
        sys.stdout.write(json.dumps({"joints": rows}, indent=1) + "\n")
        return
    sys.stdout.write("".join(lines))
