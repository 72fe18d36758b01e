"""`cjt-gym train`: train a policy as a TOML file says."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cjt_gym.errors import ConfigurationError, unknown_name
from cjt_gym.plant.randomization import PRESETS
from cjt_gym.training.config import config_names, load_config
from cjt_gym.training.distributed import train_on_ray
from cjt_gym.training.run_folder import RunFolder
from cjt_gym.training.seeds import train_seeds
from cjt_gym.training.train import train

BACKENDS = ("loky", "ray")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, the run folder, and what may be changed from outside."""
    add = parser.add_argument
    names = ", ".join(config_names())
    add("config", metavar="CONFIG.toml", help=f"a file, or one that ships: {names}")
    add("--out", type=Path, required=True, metavar="RUN", help="run folder; a stopped run goes on")
    text = "joint that replaces the configuration's, with its effects and randomization"
    add("--joint", metavar="JOINT|FILE.toml", help=text)
    add("--structure", metavar="S", help="replaces the structure of the configuration")
    add(
        "--randomization",
        metavar="PRESET",
        help=f"replaces its randomization: {', '.join(PRESETS)}",
    )
    add("--seed", type=int, help="replaces the seed of the configuration")
    add("--steps", type=int, help="replaces its total_steps")
    text = "train from N seeds into the folders RUN_0, RUN_1 ..., instead of once into RUN"
    add("--seeds", type=int, metavar="N", help=text)
    add("--jobs", type=int, default=1, help="trainings side by side with --seeds, default 1")
    text = "where they train: loky for processes here, or ray, with RAY_ADDRESS or a cluster here"
    add("--backend", default="loky", metavar="B", help=text)
    add("--quiet", action="store_true", help="no progress bar")


def environment(env: Mapping[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """Return a section [env] with what the options replace.

    Effects and randomization of a configuration are about its own joint: with another joint the
    effects are those that its file lists, and nothing varies unless --randomization says so.
    """
    kept = dict(env)
    if options.joint is not None:
        kept.pop("effects", None)
        kept.pop("randomization", None)
    given = {name: getattr(options, name) for name in ("joint", "structure", "randomization")}
    return {**kept, **{name: word for name, word in given.items() if word is not None}}


def run(options: argparse.Namespace) -> None:
    """Train and say where the run is."""
    config = load_config(options.config)
    env = environment(config.env, options)
    config = config.with_changes(env=env, seed=options.seed, total_steps=options.steps)
    if options.backend not in BACKENDS:
        raise unknown_name("backend", options.backend, BACKENDS)
    if options.seeds is None and options.backend != "loky":
        raise ConfigurationError(f"--backend {options.backend} needs --seeds.")
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
