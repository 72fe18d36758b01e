"""`cjt-gym export`: joints for other simulators; policies and control laws for control loops."""

from __future__ import annotations

import argparse
from pathlib import Path

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.baselines.compose import is_composed
from cjt_gym.baselines.gains import choose, files_of
from cjt_gym.baselines.observers import OBSERVERS, make_observer
from cjt_gym.baselines.own import is_own
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.console import Answer
from cjt_gym.console.options import (
    add_conditions,
    asked_effects,
    chosen_joint,
    structure_of,
    tell_effects,
)
from cjt_gym.disk import refuse_inputs, write_text
from cjt_gym.envs.settings import default_load, told_load
from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.export import TARGETS, Export, to_isaaclab, to_mujoco
from cjt_gym.export.c_files import Header, controller_to_c, observer_to_c
from cjt_gym.joint import Joint, load_joint
from cjt_gym.records import read_record
from cjt_gym.training.deploy.shipped import policy_names

FORMS = ("onnx", "numpy", "c")
"""Forms of an exported policy; controllers and observers are written in C."""
ENDINGS = {
    "mujoco": (".xml",),
    "isaaclab": (".yaml", ".yml"),
    "onnx": (".onnx",),
    "numpy": (".npz",),
    "c": (".h",),
}
"""What the file of each target may end in."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to export, for what, and where to write it."""
    add = parser.add_argument
    text = "name of a joint or path of a joint file; for a policy, its run folder, its file or its "
    text += "name (cjt-gym policies); with --to c a "
    text += f"controller (table, parts, gain file) or an observer: {', '.join(OBSERVERS)}"
    add("source", metavar="JOINT|RUN|CONTROLLER|OBSERVER", help=text)
    text = f"simulator for a joint: {', '.join(TARGETS)}; form of a policy: {', '.join(FORMS)}"
    add("--to", required=True, choices=[*TARGETS, *FORMS], help=text)
    add_conditions(parser, draws=False)
    add("--timestep", type=float, help="time step of the simulation that will use it [s]")
    text = "mujoco: do without dcmotor, which versions before 4 lack"
    add("--without-dcmotor", action="store_true", help=text)
    _add_arguments_of_laws(parser)
    text = "policy: also compare the file with the run on the signals of these records"
    add("--check", nargs="+", default=[], metavar="RECORD", help=text)
    text = ", ".join(f"{' or '.join(endings)} for {to}" for to, endings in ENDINGS.items())
    add("--out", type=Path, required=True, metavar="FILE", help=f"file to write: {text}")


def run(options: argparse.Namespace) -> Answer:
    """Write the file; say what it holds and what it cannot."""
    refuse_inputs([options.out], [options.source, *options.check])
    _check_ending(options.out, options.to)
    if options.check and (options.to not in FORMS or is_classical(options.source)):
        raise ConfigurationError("--check is for policies; controllers are always checked.")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    if options.to == "c" and is_classical(options.source):
        return _write_law(options)
    if options.to in FORMS:
        records = [read_record(path) for path in options.check]
        from cjt_gym.training.deploy.export import export_policy

        if options.to == "c":
            _check_name(options.source)
        result = export_policy(options.source, options.to, options.out, records)
        return result.to_dict(), result.summary()
    joint = chosen_joint(options, options.source)
    step = {} if options.timestep is None else {"timestep": options.timestep}
    if options.to == "mujoco":
        found = to_mujoco(joint, dcmotor=not options.without_dcmotor, **step)
    else:
        found = to_isaaclab(joint, **step)
    write_text(options.out, found.text)
    tell_effects(joint)
    return {"file": str(options.out), **found.to_dict()}, _summary(options.out, found)


def _check_name(word: str) -> None:
    """Refuse a name that neither a policy nor a controller or an observer has."""
    known = [*CONTROLLERS, *OBSERVERS, *policy_names()]
    path = Path(word)
    if not (path.exists() or len(path.parts) > 1 or path.suffix or word in known):
        raise unknown_name("controller, observer, policy or run folder", word, known)


def _check_ending(path: Path, target: str) -> None:
    """Raise ConfigurationError if a file's name does not say what will be in it."""
    endings = ENDINGS[target]
    if path.suffix not in endings:
        raise ConfigurationError(
            f"--out of --to {target} must end in {' or '.join(endings)}, got {path}. Write "
            f"--out {path.with_name(path.stem + endings[0])}"
        )


def _summary(path: Path, found: Export) -> str:
    lines = [f"{path}"]
    for title, rows in (
        ("expressed", found.exact),
        ("approximated", found.nearly),
        ("left out", found.missing),
    ):
        lines += [f"  {title}: {name} ({text})" for name, text in rows.items()]
    return "\n".join(lines)


def _add_arguments_of_laws(parser: argparse.ArgumentParser) -> None:
    """Add what a controller or an observer is written for."""
    add = parser.add_argument
    add("--joint", metavar="J", help="joint of a controller or an observer: name or path of a file")
    text = "gains of a controller or an observer that replace its own: drift=0.05 torque_noise=0.1"
    add("--gain", nargs="+", default=[], metavar="NAME=VALUE", help=text)
    add("--output", nargs="+", metavar="SIGNAL", help="signals that an observer measures")
    add("--dt", type=float, default=1e-3, help="control step [s], default 0.001")


def is_classical(word: str) -> bool:
    """Return whether a word names a controller, a gain file, or an observer."""
    named = word in CONTROLLERS or word in OBSERVERS or is_composed(word) or is_own(word)
    return named or word.endswith(".toml")


def _write_law(options: argparse.Namespace) -> Answer:
    """Write a controller or an observer as a C header; say how it compares with Python."""
    if options.joint is None:
        raise ConfigurationError(f"--joint must name the joint that {options.source} is for.")
    refuse_inputs([options.out], [options.joint, *files_of(options.source)])
    structure = structure_of(options.joint, options.structure)
    load = default_load(options.joint, structure, {})
    joint = load_joint(options.joint, structure, options.drive, asked_effects(options), load)
    gains, prefix = _gains(options.gain), Path(options.out).stem
    if options.source in OBSERVERS:
        made = _observer_header(options, joint, gains, prefix)
    else:
        if options.output is not None:
            raise ConfigurationError("--output is for observers; a controller takes what it needs.")
        made = _controller_header(options, joint, gains, prefix)
    write_text(options.out, made.text)
    tell_effects(joint)
    checked = made.checked
    result = {"file": str(options.out), "form": "c", "steps": checked.steps}
    known = {"error": checked.error if checked.steps else None, "note": checked.note}
    told = f"as in Python to {checked.error:.1e} of its largest output, {checked.steps} steps"
    line = f"{options.out}: {told if checked.steps else f'not tried. {checked.note}'}"
    return result | known, f"{line.rstrip('.')}{told_load(joint, load)}."


def _observer_header(
    options: argparse.Namespace, joint: Joint, gains: dict[str, float], prefix: str
) -> Header:
    outputs = None if options.output is None else tuple(options.output)
    observer = make_observer(options.source, SampledJoint(joint, options.dt), gains, outputs)
    return observer_to_c(observer, joint, options.source, prefix)


def _controller_header(
    options: argparse.Namespace, joint: Joint, gains: dict[str, float], prefix: str
) -> Header:
    choice = choose(options.source).with_gains(gains).spelt_out(joint, options.dt)
    controller = choice.make(joint, options.dt)
    return controller_to_c(controller, joint, choice.name, prefix, choice.gains)


def _gains(words: list[str]) -> dict[str, float]:
    gains = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            gains[name] = float(text)
        except ValueError:
            raise ConfigurationError(f"--gain {word} must be NAME=NUMBER.") from None
    return gains
