"""`cjt-gym tune`: gains of a controller for a joint, by search on the simulator."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import fields
from pathlib import Path
from typing import Any

from cjt_gym import __version__
from cjt_gym.baselines import get_entry
from cjt_gym.baselines.gains import WITH, choose, read_gains, write_gains
from cjt_gym.baselines.own import is_own
from cjt_gym.baselines.table import CONTROLLER_HELP
from cjt_gym.console import Answer
from cjt_gym.console.options import (
    add_conditions,
    check_randomize,
    drive_of,
    effect_words,
    structure_of,
    tell_effects,
)
from cjt_gym.errors import ConfigurationError, check_name, check_range
from cjt_gym.plant.simulated import DT_PHYSICS
from cjt_gym.training.benchmark.cluster import BACKENDS, cluster
from cjt_gym.training.evaluation.rollout import joint_of
from cjt_gym.training.tuning.limits import Limits
from cjt_gym.training.tuning.problem import Search
from cjt_gym.training.tuning.tune import Outcome, tune

STEP, LONGEST = 1e-3, 0.02
"""Usual and longest control step [s]."""
LIMITS = {
    "--gain-margin": "smallest gain margin [-]",
    "--phase-margin": "smallest phase margin [deg]",
    "--delay-margin": "smallest delay margin [s]",
    "--sensitivity-peak": "largest sensitivity Ms",
    "--noise-amplification": "largest command for the sensors' noise, "
    "over that of the torque sensor",
    "--port-share": "damping of the environment with which the output must be passive, as a share "
    "of sqrt(k_b (I_m + I_g))",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to tune, within which limits, how long, and where to write it."""
    add = parser.add_argument
    add("controller", metavar="CONTROLLER", help=CONTROLLER_HELP)
    add("--joint", required=True, help="name of a joint, or path of a joint file")
    text = "friction, sensors and what the joint file lists, ripple, delays (docs/benchmark.md)"
    add_conditions(parser, effects=text)
    add("--out", type=Path, required=True, metavar="FILE.toml", help="gain file to write")
    text = "control step of the loop that the gains are for [s], default 0.001"
    add("--dt", type=float, default=STEP, help=text)
    add("--budget", type=int, default=200, help="candidates to try, default 200")
    add("--seed", type=int, default=0, help="seed of the search and its draws, 0 to 99, default 0")
    add("--episodes", type=int, default=32, help="parallel episodes per candidate, default 32")
    add("--jobs", type=int, default=1, help="parallel processes, default 1")
    text = "where candidates run: processes here, or a cluster; default loky"
    add("--backend", default="loky", metavar="B", help=f"{', '.join(BACKENDS)}: {text}")
    for limit in fields(Limits):
        default = f", default {limit.default:g}"
        option = f"--{limit.name.replace('_', '-')}"
        add(option, type=float, default=limit.default, help=LIMITS[option] + default)


def _workers(backend: str, jobs: int) -> AbstractContextManager[Any]:
    """Return joblib's context in which candidates run side by side."""
    check_name("backend", backend, BACKENDS)
    if jobs > 1:
        return cluster(backend, jobs)
    if backend != "loky":
        raise ConfigurationError(f"--backend {backend} needs --jobs of at least 2, got {jobs}.")
    return nullcontext()


def run(options: argparse.Namespace) -> Answer:
    """Search, write the gain file, and say what came out. An interrupted search is resumed."""
    options.structure = structure_of(options.joint, options.structure)
    check_out(options)
    asked = effect_words(options)
    limits = Limits(**{limit.name: getattr(options, limit.name) for limit in fields(Limits)})
    check_range("--dt", options.dt, "s", low=DT_PHYSICS, high=LONGEST)
    search = Search(
        options.controller,
        options.joint,
        options.structure,
        options.budget,
        options.seed,
        options.episodes,
        limits,
        dt=options.dt,
        drive=drive_of(options.joint, options.drive),
        effects=None if asked is None else tuple(asked),
        randomization=check_randomize(options),
    )
    tell_effects(joint_of(search.conditions()))
    begun = time.monotonic()
    trials = options.out.with_suffix(".trials.jsonl")
    with _workers(options.backend, options.jobs):
        outcome = tune(search, trials, options.jobs, Progress(search.budget))
    known = {"command": command(options), "version": __version__}
    facts = {**known, **outcome.facts(), "seconds": round(time.monotonic() - begun, 1)}
    write_gains(options.out, search.controller, outcome.best.gains, facts)
    result = {
        "file": str(options.out),
        "controller": search.controller,
        "gains": outcome.best.gains,
        **facts,
    }
    return result, words(outcome)


def check_out(options: argparse.Namespace) -> None:
    """Raise an error if the gain file has another ending or holds the result of another search."""
    out: Path = options.out
    if out.suffix != ".toml":
        raise ConfigurationError(f"--out must end in .toml, as every gain file, got {out}.")
    if not out.exists():
        return
    own = is_own(options.controller)
    known = choose(f"{options.controller}{WITH}{out}") if own else read_gains(out)
    wanted = (options.controller, options.joint, options.structure)
    if (known.controller, known.facts.get("joint"), known.facts.get("structure")) != wanted:
        raise ConfigurationError(
            f"{out} holds gains of {known.controller} for {known.facts.get('joint')}, "
            f"{known.facts.get('structure')}. Give another --out, or move that file away."
        )


class Progress:
    """A progress bar on standard error."""

    def __init__(self, total: int) -> None:
        self.total = total
        self.bar: Any = None

    def __call__(self, done: int, cost: float) -> None:
        """Advance the bar and show the lowest cost so far."""
        if self.bar is None:  # not before the search has been found possible
            from tqdm import tqdm

            self.bar = tqdm(total=self.total, file=sys.stderr, unit="candidate", disable=None)
        self.bar.set_postfix_str("none keeps the limits" if cost >= 10.0 else f"best {cost:.3f}")
        self.bar.update(done - self.bar.n)
        if done >= self.bar.total:
            self.bar.close()


def command(options: argparse.Namespace) -> str:
    """Return the command that repeats the search."""
    words = ["cjt-gym", "tune", options.controller, "--joint", options.joint]
    words += ["--structure", options.structure, "--budget", str(options.budget)]
    words += ["--seed", str(options.seed), "--episodes", str(options.episodes)]
    if options.dt != STEP:
        words += ["--dt", f"{options.dt:g}"]
    if options.drive is not None:
        words += ["--drive", options.drive]
    if options.effect is not None:
        words += ["--effect", *options.effect]
    if options.randomize is not None:
        words += ["--randomize", options.randomize]
    for limit in fields(Limits):
        value = getattr(options, limit.name)
        if value != limit.default:
            words += [f"--{limit.name.replace('_', '-')}", f"{value:g}"]
    return shlex.join([*words, "--out", options.out.name])


def words(outcome: Outcome) -> str:
    """Say in words what came out."""
    units = {gain.name: gain.unit for gain in get_entry(outcome.search.controller).tunable}
    gains = ", ".join(
        f"{name} {value:g}" + (f" {units[name]}" if units[name] != "-" else "")
        for name, value in outcome.best.gains.items()
    )
    held, a = outcome.held_out, outcome.assessment
    port = "unknown" if a.port_share is None else f"{100.0 * a.port_share:.3g} %"
    lines = [
        gains,
        f"error over that of the open loop, on unseen draws: {held['tuned']:.3f}, designed gains "
        f"{held['designed']:.3f}, ratio {held['ratio']:.3f} ({held['low']:.3f} .. "
        f"{held['high']:.3f})",
        f"gain margin {a.gain_margin:.3g}, phase margin {a.phase_margin:.3g} deg, delay margin "
        f"{1e3 * a.delay_margin:.3g} ms, Ms {a.sensitivity_peak:.3g}, noise "
        f"{a.noise_amplification:.3g}, damping that the port lacks, of sqrt(k I), {port}"
        if a.stable
        else "The loop around the nominal joint is unstable.",
    ]
    if not a.linear:
        lines.append(
            "The controller is not linear; its margins are measured with multisines in simulation."
        )
    if not outcome.feasible:
        lines.append("No candidate meets all limits; this one violates them least.")
    elif outcome.best == outcome.start:
        lines.append("No candidate is better than the designed gains; the file holds those.")
    elif held["low"] > 1.0:
        breaks = ", but violate the limits" if outcome.start.violation > 0.0 else ""
        lines.append(f"The designed gains are better on unseen draws{breaks}.")
    return "\n".join(lines)
