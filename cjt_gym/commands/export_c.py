"""`cjt-gym export CONTROLLER|OBSERVER --to c`: a classical control loop as a C header."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

from cjt_gym.baselines import CONTROLLERS, default_gains
from cjt_gym.baselines.compose import is_composed
from cjt_gym.baselines.observers import OBSERVERS, make_observer
from cjt_gym.baselines.own import is_own
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.console.options import asked_effects, structure_of, tell_effects
from cjt_gym.disk import refuse_inputs, write_text
from cjt_gym.envs.settings import default_load
from cjt_gym.errors import ConfigurationError
from cjt_gym.export.c_files import Header, controller_to_c, observer_to_c
from cjt_gym.joint import Joint, load_joint
from cjt_gym.training.tuning.gains import choose, files_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what a controller or an observer is written for."""
    add = parser.add_argument
    add("--joint", metavar="J", help="joint of a controller or an observer, or path of its file")
    text = "of a controller, instead of its own, or of an observer: drift=0.05 torque_noise=0.1"
    add("--gain", nargs="+", default=[], metavar="NAME=VALUE", help=text)
    add("--output", nargs="+", metavar="SIGNAL", help="measured signals of an observer")
    add("--dt", type=float, default=1e-3, help="control step of both [s], default 0.001")


def is_classical(word: str) -> bool:
    """Return whether a word names a controller, a gain file, or an observer."""
    named = word in CONTROLLERS or word in OBSERVERS or is_composed(word) or is_own(word)
    return named or word.endswith(".toml")


def run(options: argparse.Namespace) -> None:
    """Write the header, and say how it compares with Python."""
    if options.joint is None:
        raise ConfigurationError(f"--joint must name the joint that {options.source} is for.")
    refuse_inputs([options.out], [options.joint, *files_of(options.source)])
    structure = structure_of(options.joint, options.structure)
    load = default_load(options.joint, structure, {})
    joint = load_joint(options.joint, structure, options.drive, asked_effects(options), load)
    gains, prefix = _gains(options.gain), Path(options.out).stem
    if options.source in OBSERVERS:
        made = _observer(options, joint, gains, prefix)
    else:
        if options.output is not None:
            raise ConfigurationError("--output is for observers; a controller takes what it needs.")
        made = _controller(options, joint, gains, prefix)
    write_text(options.out, made.text)
    tell_effects(joint)
    checked = made.checked
    result = {"file": str(options.out), "form": "c", "steps": checked.steps}
    known = {"error": checked.error if checked.steps else None, "note": checked.note}
    told = f"as in Python to {checked.error:.1e} of its largest output, {checked.steps} steps"
    line = f"{options.out}: {told if checked.steps else f'not tried. {checked.note}'}"
    sys.stdout.write((json.dumps(result | known) if options.json else line) + "\n")


def _observer(
    options: argparse.Namespace, joint: Joint, gains: dict[str, float], prefix: str
) -> Header:
    outputs = None if options.output is None else tuple(options.output)
    observer = make_observer(options.source, SampledJoint(joint, options.dt), gains, outputs)
    return observer_to_c(observer, joint, options.source, prefix)


def _controller(
    options: argparse.Namespace, joint: Joint, gains: dict[str, float], prefix: str
) -> Header:
    choice = choose(options.source).with_gains(gains)
    known = choice.entry.complete(choice.gains)
    if len(known) < len(choice.entry.tunable):
        known = default_gains(choice.controller, joint, options.dt) | dict(choice.gains)
    controller = replace(choice, gains=known).make(joint, options.dt)
    return controller_to_c(controller, joint, choice.name, prefix, known)


def _gains(words: list[str]) -> dict[str, float]:
    gains = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            gains[name] = float(text)
        except ValueError:
            raise ConfigurationError(f"--gain {word} must be NAME=NUMBER.") from None
    return gains
