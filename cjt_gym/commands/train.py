"""`cjt-gym train`: train a policy as a TOML file says."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from cjt_gym.training.config import config_names, load_config
from cjt_gym.training.train import train


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the configuration, the run folder, and what may be changed from outside."""
    add = parser.add_argument
    names = ", ".join(config_names())
    add("config", metavar="CONFIG.toml", help=f"a file, or one that ships: {names}")
    add("--out", type=Path, required=True, metavar="RUN", help="run folder; a stopped run goes on")
    add("--seed", type=int, help="replaces the seed of the configuration")
    add("--steps", type=int, help="replaces its total_steps")
    add("--quiet", action="store_true", help="no progress bar")


def run(options: argparse.Namespace) -> None:
    """Train and say where the run is."""
    config = load_config(options.config)
    config = config.with_changes(seed=options.seed, total_steps=options.steps)
    folder = train(config, options.out, quiet=options.quiet)
    facts = folder.facts
    if options.json:
        sys.stdout.write(json.dumps({"run": str(folder.path), **facts}, default=str) + "\n")
    else:
        sys.stdout.write(f"{folder.path}: {facts['status']} after {facts['steps']} steps\n")
