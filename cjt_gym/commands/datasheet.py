"""`cjt-gym datasheet`: what a joint can do, on a few pages."""

from __future__ import annotations

import argparse
from pathlib import Path

from cjt_gym.console import Answer
from cjt_gym.console.options import add_joint, check_joint
from cjt_gym.datasheet import FORMATS, check_out, make_sheet, quantities, write_sheet
from cjt_gym.joint import load_joint_file


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the joints and the file to write."""
    add_joint(parser, several=True)
    text = f"file to write ({', '.join(FORMATS)}); may be left out with --json"
    parser.add_argument("--out", type=Path, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Write the sheet, and print its numbers where they are asked for."""
    check_joint(options.joints)
    check_out(options.out, optional=options.json)
    files = [load_joint_file(name) for name in options.joints]
    written: tuple[Path, ...] = ()
    if options.out is not None:
        written = write_sheet(make_sheet(files), options.out)
    paths = [str(path) for path in written]
    return {"files": paths, **quantities(files)} if options.json else None, " ".join(paths)
