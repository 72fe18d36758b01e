"""What `cjt-gym hardware` is asked to run: references, controllers, records, series that go on."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.experiments import (
    EXPERIMENTS,
    HEADROOM,
    experiment_torque,
    fitting_share,
)
from cjt_gym.canbus.timing import Timing
from cjt_gym.console.options import check_seed
from cjt_gym.envs.settings import default_amplitude
from cjt_gym.errors import ConfigurationError
from cjt_gym.records import Record, read_record, record_names
from cjt_gym.signals import make_signals, signal_from_file

Floats = NDArray[np.float64]
NONE, TRACKING = "none", "pd_feedforward"
DRY = 1.0
"""Length of a dry run where none is given [s]."""


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        path: Its record, None for none.
        reference: Joint torque that is wanted, or motor torque that is commanded [N m], by control
            step.
        controller: A row of `CONTROLLERS`, a gain file, or `NONE`.
        policy: Run folder of a policy, or None.
        facts: What else belongs to the record's provenance.
    """

    path: Path | None
    reference: Floats
    controller: str
    policy: str | None
    facts: dict[str, Any]


def outcome(
    job: Job, path: Path | None, errors: Floats, timing: Timing, dt: float
) -> dict[str, Any]:
    """Return what came out of a run, as plain data.

    Args:
        job: What was asked for.
        path: Its record, None for none.
        errors: Of the joint torque, empty where nothing was tracked [N m].
        timing: How regular the loop was.
        dt: Control step [s].
    """
    return {
        "record": None if path is None else str(path),
        "samples": len(job.reference),
        "rmse": float(np.sqrt(np.mean(np.square(errors)))) if errors.size else None,
        "timing_us": timing.summary(),
        "delays_s": timing.delay(dt),
    }


def jobs_of(config: HardwareConfig, options: argparse.Namespace) -> Sequence[Job]:
    """Return the runs that are asked for; of a series those that are not recorded yet."""
    check_seed(options.seed)
    if options.benchmark is not None:
        return _missing(_tasks(config, options))
    if options.experiment is None:
        return [tracking(config, options)]
    names = list(EXPERIMENTS) if options.experiment == ["all"] else options.experiment
    jobs = []
    for name in names:
        torque = experiment_torque(name, config.joint, config.limits, config.dt)
        path = None if options.out is None else options.out / f"{name}.csv"
        facts = {"excitation": name, "mode": "open loop"}
        jobs.append(Job(path, torque, NONE, None, facts))
    return _missing(jobs)


def _missing(jobs: Sequence[Job]) -> Sequence[Job]:
    """Return the jobs of a series that have no complete record; move broken records away."""
    found = []
    for job in jobs:
        path = job.path
        if path is not None and path.exists():
            if _is_complete(path, job):
                sys.stderr.write(f"{path.stem}: recorded already, skipped\n")
                continue
            path.rename(path.with_suffix(".broken.csv"))
        found.append(job)
    return found


def _tasks(config: HardwareConfig, options: argparse.Namespace) -> Sequence[Job]:
    """Return the runs of the benchmark."""
    from cjt_gym.hardware.beside_simulation import SECONDS, reference_of, runs_of

    if options.experiment is not None or options.controller == NONE:
        raise ConfigurationError("--benchmark needs a --controller or a --policy.")
    seed = options.seed
    seconds = SECONDS if options.duration is None else options.duration
    controller = options.controller or TRACKING
    jobs = []
    for name in runs_of(options.benchmark):
        make = partial(reference_of, name, dt=config.dt, duration=seconds, seed=seed)
        amplitude, reference = _with_amplitude(config, options, make)
        path = None if options.out is None else options.out / f"{name}.csv"
        facts: dict[str, Any] = {"task": name, "amplitude": amplitude, "seed": seed}
        facts |= {"policy": options.policy} if options.policy else {"controller": controller}
        jobs.append(Job(path, reference, controller, options.policy, facts))
    return jobs


def _with_amplitude(
    config: HardwareConfig, options: argparse.Namespace, make: Callable[[float], Floats]
) -> tuple[float, Floats]:
    """Return amplitude and reference [N m]; without a given one the nominal joint keeps its limits.

    Args:
        config: The joint on its bus.
        options: Of the command.
        make: Makes the reference of an amplitude, which it is proportional to.
    """
    if options.amplitude is not None:
        if not 0.0 < options.amplitude <= config.limits.tau:
            raise ConfigurationError(
                f"--amplitude must be > 0 and <= {config.limits.tau:g} N m, the limit on the "
                f"joint torque of {config.joint_name}, got {options.amplitude:g}."
            )
        return float(options.amplitude), make(options.amplitude)
    usual = min(default_amplitude(config.joint.parameters), HEADROOM * config.limits.tau)
    reference = make(usual)
    share = fitting_share(config.joint, reference, config.limits, config.dt)
    return share * usual, share * reference


def _is_complete(path: Path, job: Job) -> bool:
    """Return whether a record is all of a job.

    Raises:
        ConfigurationError: It is that of another one.
    """
    known = read_record(path).provenance
    if "fault" in known or "timing_us" not in known:
        return False
    for name, value in job.facts.items():
        if known.get(name) != value:
            raise ConfigurationError(
                f"{path} has {name} {known.get(name)!r}, this series has {value!r}. Give another "
                "--out, or the same options as before."
            )
    return True


def tracking(config: HardwareConfig, options: argparse.Namespace) -> Job:
    """Return the run of a controller or policy along a reference.

    Raises:
        ConfigurationError: An option is out of its range.
    """
    word = options.reference
    record = read_record(word) if Path(word).suffix or word in record_names() else None
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
        reference = drawn(signal_from_file(word), 1.0)
    if options.policy is None:
        facts |= {"controller": controller} | ({"mode": "open loop"} if controller == NONE else {})
    else:
        facts["policy"] = str(options.policy)
    return Job(options.out, reference, controller, options.policy, facts)


def _commanded(record: Record, config: HardwareConfig) -> Callable[[Floats], Floats]:
    """Return the motor torque [N m] that a record commands, as a function of time."""
    p = config.joint.parameters
    torque = record["i_cmd"] * p.k_t * p.n if "i_cmd" in record else record["tau_cmd"]
    t = record.t - record.t[0]
    return lambda at: torque[np.clip(np.searchsorted(t, at + 1e-9) - 1, 0, len(t) - 1)]
