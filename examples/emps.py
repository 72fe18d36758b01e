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
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cjt_gym.gap import diagnose
from cjt_gym.gap.candidates.table import all_candidates
from cjt_gym.gap.judged.gap_size import followed, main_channel, relative
from cjt_gym.gap.judged.replay import written
from cjt_gym.gap.recorded.setting import as_noisy, make_setting
from cjt_gym.gap.stages.cut import Stages
from cjt_gym.gap.stages.fit import Model, Problem
from cjt_gym.joint import get_structure, load_joint_file, to_toml
from cjt_gym.records import read_record
from cjt_gym.training.demo.emps import PUBLISHED, replay

EVEN = ("damping", "coulomb", "torque_offset")
LADDER = ((), *(EVEN[:k] for k in (1, 2, 3)), ("viscous_asym", "coulomb_asym"))
RECORDS = ("emps", "emps_pulses")
MOVES = 30
"""Steps of the fit of each model."""


def main() -> None:
    """Print the ladder, and the closed-loop errors."""
    show_ladder()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joint.toml"
        fitted, unseen = map(read_record, RECORDS)
        path.write_text(to_toml(diagnose(fitted, validate=unseen).joint), encoding="utf-8")
        show_closed_loop(path)


def ladder() -> Iterator[tuple[tuple[str, ...], list[float]]]:
    """Yield the effects of each model, and its relative error of the force on both records.

    Every model is fitted anew to the first record; datasheet values stay nominal.
    """
    fitted, unseen = map(read_record, RECORDS)
    file, rigid = load_joint_file(fitted.joint_file or ""), get_structure("rigid")
    problem = Problem.of(Stages(make_setting(fitted, file, rigid)))
    problem.shared = tuple(n for n in problem.shared if not n.unknown.prior)
    known = problem.stages.setting
    tested = [known, as_noisy(make_setting(unseen, file, rigid), known)]
    candidates = all_candidates(known, problem.stages.names)
    for names in LADDER:
        effects = tuple(next(row for row in candidates if row.name == name) for name in names)
        starts = [zip(e.unknowns, e.starts[0], strict=True) for e in effects]
        z = [unknown.coordinate(x) for start in starts for unknown, x in start]
        start = np.concatenate([np.zeros(len(problem.shared)), z])
        fit = problem.fit(Model(effects), start, MOVES)
        model = written(problem, fit.model, fit.z)
        forces = [followed(setting, [model])[main_channel(setting)] for setting in tested]
        yield names, [float(relative([force])[0]) for force in forces]


def show_ladder() -> None:
    """Print the open-loop error of the force of each model."""
    print_row("force from the measured motion", *RECORDS)
    for effects, errors in ladder():
        name = ", ".join(effects) or "nominal joint, without friction"
        print_row(name, *(f"{100.0 * error:.2f} %" for error in errors))


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
