"""The runs of `cjt-gym hardware`: references, controllers, records, resumed series."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.baselines.gains import choose
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.experiments import (
    EXPERIMENTS,
    HEADROOM,
    experiment_torque,
    fitting_share,
)
from cjt_gym.console.options import check_seed
from cjt_gym.envs.settings import default_amplitude
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record, part_of, read_record, record_names
from cjt_gym.signals import make_signals, signal_of_record

NONE, TRACKING = "none", "pd_feedforward"
APART = 1000
"""Between the seeds of two joints' references."""
DRY = 1.0
"""Length of a dry run where none is given [s]."""


@dataclass(frozen=True)
class Job:
    """The task of one joint in a run: follow a reference, under a controller or a policy.

    With the controller `NONE` the reference is the commanded motor torque [N m].
    """

    name: str
    reference: Floats
    controller: str
    policy: str | None
    facts: dict[str, Any]


@dataclass(frozen=True)
class Run:
    """One run of all joints, and the file of its record, if any."""

    path: Path | None
    jobs: tuple[Job, ...]

    @property
    def title(self) -> str:
        """Name shown during the run."""
        return "running" if self.path is None else f"recording {self.path.stem}"


def runs_of(configs: Sequence[HardwareConfig], options: argparse.Namespace) -> Sequence[Run]:
    """Return the runs to carry out; for a series, those that are not recorded yet."""
    check_seed(options.seed)
    out = None if options.dry_run else options.out
    each = [of_joint(options, k, configs) for k in range(len(configs))]
    if options.benchmark is not None:
        from cjt_gym.hardware.beside_simulation import tasks_of

        if options.experiment is not None or any(own.controller == NONE for own in each):
            raise ConfigurationError("--benchmark needs a --controller or a --policy.")
        names, make = list(tasks_of(options.benchmark)), _task
    elif options.experiment is not None:
        names = list(EXPERIMENTS) if options.experiment == ["all"] else options.experiment
        make = _experiment
    else:
        run = Run(out, tuple(map(tracking, configs, each)))
        return [run]
    runs = []
    for name in names:
        path = None if out is None else out / f"{name}.csv"
        jobs = (make(name, config, own) for config, own in zip(configs, each, strict=True))
        runs.append(Run(path, tuple(jobs)))
    return _missing(runs)


def of_joint(
    options: argparse.Namespace, k: int, configs: Sequence[HardwareConfig]
) -> argparse.Namespace:
    """Return the options of the k-th joint, with its own controller or policy and reference."""
    own = {**vars(options), "seed": options.seed + APART * k}
    for name in ("controller", "policy"):
        words = own[name]
        if words is not None and len(words) not in (1, len(configs)):
            joints = ", ".join(config.name for config in configs) or "the only joint"
            raise ConfigurationError(
                f"--{name} must be given once for all joints, or once for each of {joints}, got "
                f"{len(words)} of them."
            )
        own[name] = words and words[k % len(words)]
    return argparse.Namespace(**own)


def _made_by(controller: str, policy: str | None) -> dict[str, Any]:
    """Return what a record says of what made it; an unknown controller is an error here."""
    if policy is not None:
        return {"policy": policy}
    if controller == NONE:
        return {"controller": NONE, "mode": "open loop"}
    name = choose(controller).controller
    return {"controller": name} | ({"gain_file": controller} if controller != name else {})


def _experiment(name: str, config: HardwareConfig, options: argparse.Namespace) -> Job:
    torque = experiment_torque(name, config.joint, config.limits, config.dt)
    return Job(config.name, torque, NONE, None, {"excitation": name, "mode": "open loop"})


def _task(name: str, config: HardwareConfig, options: argparse.Namespace) -> Job:
    from cjt_gym.hardware.beside_simulation import SECONDS, reference_of

    seconds = SECONDS if options.duration is None else options.duration
    controller = options.controller or TRACKING
    make = partial(reference_of, name, dt=config.dt, duration=seconds, seed=options.seed)
    amplitude, reference = _with_amplitude(config, options, make)
    facts: dict[str, Any] = {"task": name, "amplitude": amplitude, "seed": options.seed}
    facts |= _made_by(controller, options.policy)
    return Job(config.name, reference, controller, options.policy, facts)


def _missing(runs: Sequence[Run]) -> Sequence[Run]:
    """Return the runs of a series without a complete record; move incomplete ones away."""
    found = []
    for run in runs:
        path = run.path
        if path is not None and path.exists():
            if _is_complete(path, run.jobs):
                sys.stderr.write(f"{path.stem}: recorded already, skipped\n")
                continue
            path.rename(path.with_suffix(".broken.csv"))
        found.append(run)
    return found


def _is_complete(path: Path, jobs: Sequence[Job]) -> bool:
    known = read_record(path).provenance
    if "fault" in known or "timing_us" not in known:
        return False
    for job in jobs:
        own = known if len(jobs) == 1 else known.get("joints", {}).get(job.name, {})
        for name, value in job.facts.items():
            if own.get(name) != value:
                raise ConfigurationError(
                    f"{path} has {name} {own.get(name)!r}, this run has {value!r}. Give another "
                    "--out, or the same options as before."
                )
    return True


def _with_amplitude(
    config: HardwareConfig, options: argparse.Namespace, make: Callable[[float], Floats]
) -> tuple[float, Floats]:
    """Return amplitude and reference [N m]; the default keeps the nominal joint within its limits.

    The reference is proportional to the amplitude.
    """
    if options.amplitude is not None:
        if not 0.0 < options.amplitude <= config.limits.tau:
            raise ConfigurationError(
                f"--amplitude must be > 0 and <= {config.limits.tau:g} N m, the limit on the "
                f"joint torque of {config.joint_name}, got {options.amplitude:g}."
            )
        return float(options.amplitude), make(options.amplitude)
    usual = min(default_amplitude(config.joint.file), HEADROOM * config.limits.tau)
    reference = make(usual)
    share = fitting_share(config.joint, reference, config.limits, config.dt)
    return share * usual, share * reference


def tracking(config: HardwareConfig, options: argparse.Namespace) -> Job:
    """Return the task of a joint that tracks a reference under a controller or policy."""
    word = options.reference
    record = read_record(word) if Path(word).suffix or word in record_names() else None
    record = record and part_of(record, config.name)
    tracked = record is None or "tau_ref" in record
    controller = options.controller or (TRACKING if tracked else NONE)
    length = 10.0 if record is None else record.t[-1] - record.t[0] + record.dt
    if options.dry_run:
        length = min(length, DRY)
    duration = length if options.duration is None else options.duration
    samples = round(duration / config.dt)
    if samples < 1:
        raise ConfigurationError(f"--duration must be >= one control step, got {duration} s.")
    t = np.arange(samples) * config.dt
    facts: dict[str, Any] = {"reference": word, "seed": options.seed}

    def drawn(spec: object, amplitude: float) -> Floats:
        (signal_,) = make_signals(spec, amplitude)[:1]
        return signal_.reset(np.random.default_rng(options.seed)).torque(t)

    if record is None:
        facts["amplitude"], reference = _with_amplitude(config, options, partial(drawn, word))
    elif controller == NONE:
        reference = _commanded(record, config)(t)
    else:
        reference = drawn(signal_of_record(record), 1.0)
    facts |= _made_by(controller, options.policy)
    return Job(config.name, reference, controller, options.policy, facts)


def _commanded(record: Record, config: HardwareConfig) -> Callable[[Floats], Floats]:
    """Return the motor torque [N m] that a record commands, as a function of time."""
    p = config.joint.parameters
    torque = record["i_cmd"] * p.k_t * p.n if "i_cmd" in record else record["tau_cmd"]
    t = record.t - record.t[0]
    return lambda at: torque[np.clip(np.searchsorted(t, at + 1e-9) - 1, 0, len(t) - 1)]
