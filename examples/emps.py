"""The EMPS drive, one effect after the other, and the diagnosed drive beside the published one.

First the ladder: models with more and more effects are fitted to the first record alone, and the
force that each of them needs for the measured motion is compared with the measured force, on that
record and on the one with pulses, which no model has seen. Then the drive is diagnosed from the
first record and tested on the second, and replayed in closed loop like the drive with the published
parameters: with the sampled controller of the record, and with a continuous one from rest.

Run it with  python examples/emps.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from cjt_gym.gap import diagnose
from cjt_gym.gap.rungs import rungs
from cjt_gym.joint import to_toml
from cjt_gym.records import read_record
from cjt_gym.training.demo.emps import PUBLISHED, replay

EVEN = ("damping", "coulomb", "torque_offset")
LADDER = ((), *(EVEN[:k] for k in (1, 2, 3)), ("viscous_asym", "coulomb_asym"))
RECORDS = ("emps", "emps_pulses")


def main() -> None:
    """Print the ladder, and the closed-loop errors."""
    show_ladder()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joint.toml"
        fitted, unseen = map(read_record, RECORDS)
        path.write_text(to_toml(diagnose(fitted, validate=unseen).joint), encoding="utf-8")
        show_closed_loop(path)


def show_ladder() -> None:
    """Print the open-loop error of the force of each model."""
    fitted, unseen = map(read_record, RECORDS)
    print_row("force from the measured motion", *RECORDS)
    for rung in rungs(fitted, LADDER, fitted.joint_file or "", "rigid", [unseen]):
        name = ", ".join(rung.effects) or "nominal joint, without friction"
        print_row(name, *(f"{100.0 * error:.2f} %" for error in rung.errors))


def show_closed_loop(diagnosed: Path) -> None:
    """Print the closed-loop error of the force, simulated in both ways."""
    print_row("\nforce in closed loop", *RECORDS)
    for continuous, how in ((False, "sampled controller"), (True, "continuous, from rest")):
        for joint, whose in ((diagnosed, "diagnosed"), ("emps", "published parameters")):
            errors = [replay(name, continuous, joint).errors()["force"] for name in RECORDS]
            print_row(f"{whose}, {how}", *(f"{error:.2f} %" for error in errors))
    print_row("as published", *(f"{PUBLISHED[name]['force']:.2f} %" for name in RECORDS))


def print_row(name: str, *cells: str) -> None:
    """Print a name and its cells."""
    sys.stdout.write(f"{name:44}" + "".join(f"{cell:>12}" for cell in cells) + "\n")


if __name__ == "__main__":
    main()
