"""`cjt-gym train`: train a policy as a TOML file says."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cjt_gym.console.options import (
    add_conditions,
    asked_effects,
    check_randomize,
    structure_of,
    tell_effects,
)
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import load_joint
from cjt_gym.joint.kernel.current_loop import with_current_loop
from cjt_gym.plant.simulated import DT_PHYSICS
from cjt_gym.training.evaluation.conditions import transferred
from cjt_gym.training.learning.config import config_names, load_config

if TYPE_CHECKING:
    from cjt_gym.training.learning.run_folder import RunFolder

BACKENDS = ("loky", "ray")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, the run folder, and what may be changed from outside."""
    add = parser.add_argument
    names = ", ".join(config_names())
    add("config", metavar="CONFIG.toml", help=f"a file, or one that ships: {names}")
    text = "run folder; an interrupted run is resumed"
    add("--out", type=Path, required=True, metavar="RUN", help=text)
    text = "joint that replaces the configuration's; it brings its own effects, or takes over "
    text += "those of the configuration as far as it knows the numbers"
    add("--joint", metavar="JOINT|FILE.toml", help=text)
    here = "that of the joint file with --joint, or of the configuration"
    add_conditions(parser, effects=here, structure=here)
    add("--seed", type=int, help="seed that replaces that of the configuration")
    add("--steps", type=int, help="replaces its total_steps")
    text = "train from N seeds into the folders RUN_0, RUN_1 ..., instead of once into RUN"
    add("--seeds", type=int, metavar="N", help=text)
    add("--jobs", type=int, default=1, help="parallel trainings with --seeds, default 1")
    text = "where they train: loky for processes here, or ray, with RAY_ADDRESS or a cluster here"
    add("--backend", default="loky", metavar="B", help=text)
    add("--quiet", action="store_true", help="no progress bar")


def environment(env: Mapping[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Return a section [env] with what the options replace; see `transferred` for another joint."""
    kept = dict(env) if options.joint is None else transferred(env, options.joint)
    given = {
        "structure": options.structure,
        "drive": options.drive,
        "effects": asked_effects(options),
        "randomization": check_randomize(options),
    }
    return kept | {name: value for name, value in given.items() if value is not None}


def tell(env: Mapping[str, Any], before: Mapping[str, Any]) -> None:
    """Print on standard error what is in force, and what the configuration had in addition."""
    joint = env.get("joint")
    if not isinstance(joint, str):
        return
    asked = {name: env[name] for name in ("drive", "effects") if name in env}
    told = load_joint(joint, structure_of(joint, env.get("structure")), **asked)
    told = with_current_loop(told, env.get("dt_physics", DT_PHYSICS))
    tell_effects(told)
    lost = [name for name in before.get("effects") or () if name not in told.effects]
    if lost:
        sys.stderr.write(f"Not in force, unlike in the configuration: {', '.join(lost)}\n")
    if before.get("randomization") and not env.get("randomization"):
        sys.stderr.write("Nothing varies between episodes; --randomize changes that.\n")


def run(options: argparse.Namespace) -> None:
    """Train and say where the run is."""
    config = load_config(options.config)
    env = environment(config.env, options)
    tell(env, config.env)
    config = config.with_changes(env=env, seed=options.seed, total_steps=options.steps)
    check_name("backend", options.backend, BACKENDS)
    if options.seeds is None and options.backend != "loky":
        raise ConfigurationError(f"--backend {options.backend} needs --seeds.")
    from cjt_gym.training.learning.distributed import train_on_ray, train_seeds
    from cjt_gym.training.learning.train import train  # torch takes seconds to import

    if options.seeds is None:
        _tell(train(config, options.out, quiet=options.quiet), options.json)
        return
    if options.backend == "ray":
        runs = iter(train_on_ray(config, options.out, options.seeds, workers=options.jobs))
    else:
        runs = train_seeds(config, options.out, options.seeds, options.jobs)
    for folder in runs:
        _tell(folder, options.json)


def _tell(folder: RunFolder, as_json: bool) -> None:
    facts = folder.facts
    if as_json:
        sys.stdout.write(json.dumps({"run": str(folder.path), **facts}, default=str) + "\n")
        return
    why = f" ({facts['reason']})" if facts.get("reason") else ""
    sys.stdout.write(f"{folder.path}: {facts['status']} after {facts['steps']} steps{why}\n")
