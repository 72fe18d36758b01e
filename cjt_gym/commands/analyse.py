"""`cjt-gym analyse`: linear responses of joints, compared with each other."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

from cjt_gym.analysis import identify
from cjt_gym.analysis.open_loop import INPUTS
from cjt_gym.baselines import make_controller
from cjt_gym.console import Answer
from cjt_gym.console.options import (
    add_conditions,
    add_joint,
    check_joint,
    check_seed,
    chosen_joint,
    structures_of,
    tell_effects,
)
from cjt_gym.datasheet import FORMATS, check_out, write_sheet
from cjt_gym.datasheet.linear import Case, analyse_case, linear_sheet
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import Joint
from cjt_gym.joint.linear import OUTPUTS

DT, HIGHEST = 1e-3, 200.0
"""Step of a torque that is held [s], and highest frequency that is measured [Hz]."""

LONGEST = 0.1
"""Longest sample time: the responses are drawn from well below its Nyquist frequency [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add joints, structures, and from where to where."""
    add = parser.add_argument
    add_joint(parser, several=True)
    add_conditions(parser, several=True, draws=False)
    add("--input", default="tau_m", help=f"{', '.join(INPUTS)}; default: tau_m")
    add("--output", default="tau", help=f"{', '.join(OUTPUTS)}; default: tau")
    text = "sample time of a zero-order hold at the input [s]; default: continuous"
    add("--dt", type=float, help=text)
    text = "measure the response of the joint with its effects, too: rms of the multisine of motor "
    text += f"torque [N m]; torques are held for --dt, {DT:g} s unless given"
    add("--identify", type=float, metavar="RMS", help=text)
    add("--seed", type=int, default=0, help="seed of the multisine and the noise, default 0")
    text = f"file to write ({', '.join(FORMATS)}); optional with --json"
    add("--out", type=Path, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> Answer:
    """Analyse, write the sheet, and print the figures where they are asked for."""
    check_joint(options.joints)
    check_seed(options.seed)
    check_out(options.out, optional=options.json)
    if options.identify is not None and (options.input, options.output) != ("tau_m", "tau"):
        raise ConfigurationError(
            "--identify measures from tau_m to tau; leave --input and --output at them."
        )
    dt = options.dt
    if dt is not None:
        check_range("--dt", dt, "s", above=0.0, high=LONGEST)
    if dt is None and options.identify is not None:
        dt = DT
    cases = list(_cases(options, dt or DT))
    labels = [case.label for case in cases]
    if repeated := [label for label in labels if labels.count(label) > 1]:
        raise ConfigurationError(f"Every joint must be given once, got {repeated[0]} twice.")
    written: tuple[Path, ...] = ()
    if options.out is not None:
        sheet = linear_sheet(cases, options.input, options.output, dt)
        written = write_sheet(sheet, options.out)
    for case in cases if options.identify is not None else ():
        tell_effects(case.joint)
    text = " ".join(str(path) for path in written)
    if not options.json:
        return None, text
    results = {}
    for case in cases:
        results[case.label] = analyse_case(case, options.input, options.output).to_dict()
        if case.identified is not None:
            results[case.label]["identified"] = case.identified.to_dict()
    return {"files": [str(path) for path in written], "cases": results}, text


def check_rms(rms: float, joint: Joint) -> None:
    """Refuse a multisine that the motor cannot give."""
    p = joint.parameters
    most = p.k_t * p.n * p.i_p if "i_p" in p else math.inf
    if not 0.0 < rms <= most:
        above = f" and <= {most:.4g} N m, the peak torque of {joint.file.name}" * (most < math.inf)
        raise ConfigurationError(f"--identify must be > 0{above}, got {rms:g}.")


def _cases(options: argparse.Namespace, dt: float) -> Iterator[Case]:
    for name in options.joints:
        structures = structures_of(name, options.structure)
        for structure in structures:
            joint = chosen_joint(options, name, structure)
            label = joint.file.name + (f", {structure}" if len(structures) > 1 else "")
            seen = None
            if options.identify is not None:
                check_rms(options.identify, joint)
                high = min(HIGHEST, 0.4 / dt)
                law = make_controller("open_loop", joint, dt)
                seen = identify(law, joint, dt, options.identify, seed=options.seed, high=high)
            yield Case(label, joint, seen)
