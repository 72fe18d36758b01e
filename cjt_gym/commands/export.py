"""`cjt-gym export`: joints for other simulators; policies and control laws for control loops."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cjt_gym.baselines.observers import OBSERVERS
from cjt_gym.commands import export_c
from cjt_gym.console.options import add_conditions, chosen_joint, tell_effects
from cjt_gym.disk import refuse_inputs, write_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.export import TARGETS, Export, to_isaaclab, to_mujoco
from cjt_gym.records import read_record

FORMS = ("onnx", "numpy", "c")
"""Forms of an exported policy; controllers and observers are written in C."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to export, for what, and where to write it."""
    add = parser.add_argument
    text = "name of a joint or path of a joint file; for a policy, its run folder; with --to c a "
    text += f"controller (table, parts, gain file) or an observer: {', '.join(OBSERVERS)}"
    add("source", metavar="JOINT|RUN|CONTROLLER|OBSERVER", help=text)
    text = f"simulator for a joint: {', '.join(TARGETS)}; form of a policy: {', '.join(FORMS)}"
    add("--to", required=True, choices=[*TARGETS, *FORMS], help=text)
    add_conditions(parser, draws=False)
    add("--timestep", type=float, help="of the simulation that will use it [s]")
    text = "mujoco: leave out the dcmotor, which versions before 4 lack"
    add("--without-dcmotor", action="store_true", help=text)
    export_c.add_arguments(parser)
    text = "policy: compare the file with the run on the signals of these records, too"
    add("--check", nargs="+", default=[], metavar="RECORD", help=text)
    add("--out", type=Path, required=True, metavar="FILE", help="file to write")


def run(options: argparse.Namespace) -> None:
    """Write the file; say what it holds and what it cannot."""
    refuse_inputs([options.out], [options.source, *options.check])
    if options.check and (options.to not in FORMS or export_c.is_classical(options.source)):
        raise ConfigurationError("--check is for policies; controllers are always tried.")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    if options.to == "c" and export_c.is_classical(options.source):
        export_c.run(options)
        return
    if options.to in FORMS:
        records = [read_record(path) for path in options.check]
        from cjt_gym.training.deploy.export import export_policy

        result = export_policy(options.source, options.to, options.out, records)
        text = json.dumps(result.to_dict()) if options.json else result.summary()
        sys.stdout.write(text + "\n")
        return
    joint = chosen_joint(options, options.source)
    step = {} if options.timestep is None else {"timestep": options.timestep}
    if options.to == "mujoco":
        found = to_mujoco(joint, dcmotor=not options.without_dcmotor, **step)
    else:
        found = to_isaaclab(joint, **step)
    write_text(options.out, found.text)
    tell_effects(joint)
    if options.json:
        sys.stdout.write(json.dumps({"file": str(options.out), **found.to_dict()}) + "\n")
    else:
        sys.stdout.write(_summary(options.out, found))


def _summary(path: Path, found: Export) -> str:
    lines = [f"{path}"]
    for title, rows in (
        ("expressed", found.exact),
        ("approximated", found.nearly),
        ("left out", found.missing),
    ):
        lines += [f"  {title}: {name} ({text})" for name, text in rows.items()]
    return "\n".join(lines) + "\n"
