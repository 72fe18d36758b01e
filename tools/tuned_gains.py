"""Tunes what ships in baselines/tuned: `python -m tools.tuned_gains`, `--budget 60` and so on.

One `cjt-gym tune` for every controller with gains to search, on every joint and structure that is
named, with one budget. What is there already stays; a run that was stopped goes on. Gains ship if
they keep all limits and are better than the open loop on unseen draws, unless the designed ones
keep the limits too and are better still.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.baselines.shipped import FOLDER
from cjt_gym.cli import main as cjt_gym

JOINTS = ("orange_80_6000", "avocado_100_21000")
STRUCTURES = ("output_fixed_rigid_gearbox", "rigid_gearbox")
INSIDE = ("impedance",)
"""Controllers whose gains are those of another, which is tuned itself."""


def ships(tuned: dict[str, Any]) -> bool:
    """Return whether gains ship, from what their file says."""
    found = tuned["held_out"]
    better = found["low"] <= 1.0 or not tuned["designed_feasible"]
    return bool(tuned["feasible"] and better and found["tuned"] < 1.0)


def searches(joints: Sequence[str], structures: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    """Give controller, joint and structure of every search."""
    for joint, structure, (name, row) in product(joints, structures, CONTROLLERS.items()):
        if row.searched and structure in row.structures and name not in INSIDE:
            yield name, joint, structure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the searches, and move into the package what ships."""
    parser = argparse.ArgumentParser(description="Tune the gains that ship with the package.")
    parser.add_argument("--joint", nargs="+", default=JOINTS)
    parser.add_argument("--structure", nargs="+", default=STRUCTURES)
    parser.add_argument("--controller", nargs="+", default=list(CONTROLLERS))
    parser.add_argument("--budget", default="60")
    parser.add_argument("--episodes", default="32")
    usual = Path(tempfile.gettempdir()) / "cjt_gym_tuned"
    parser.add_argument("--work", type=Path, default=usual, help="folder for all that was tried")
    options = parser.parse_args(arguments)
    for name, joint, structure in searches(options.joint, options.structure):
        at = Path(joint) / structure / f"{name}.toml"
        tried, target = options.work / at, FOLDER / at
        if name not in options.controller or target.is_file():
            continue
        words = ["tune", name, "--joint", joint, "--structure", structure, "--out", str(tried)]
        words += ["--budget", options.budget, "--episodes", options.episodes]
        if not tried.is_file() and cjt_gym(words) != 0:
            return 1
        text = tried.read_text(encoding="utf-8")
        tuned = tomllib.loads(text)["tuned"]
        if ships(tuned):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, encoding="utf-8")
        held = tuned["held_out"]
        sys.stdout.write(
            f"{name} {joint} {structure}: {'ships' if ships(tuned) else 'stays out'}, error over "
            f"open loop {held['tuned']:.3f}, designed {held['designed']:.3f}\n"
        )
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
