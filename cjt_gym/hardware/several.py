"""`cjt-gym hardware` for a configuration that lists joints: all of them run in step."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dry_run import Frames
from cjt_gym.canbus.emulated_arm import EmulatedArm
from cjt_gym.canbus.emulator import emulated_joint
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.errors import ConfigurationError
from cjt_gym.hardware.delayed_law import law_for
from cjt_gym.hardware.jobs import NONE, Job, outcome, tracking
from cjt_gym.training.tuning.gains import choose, gains_in_record

APART = 1000
"""Between the seeds of two joints' references."""


def run_arm(
    configs: Sequence[HardwareConfig], options: argparse.Namespace, frames: Frames | None
) -> dict[str, Any]:
    """Run a controller on every joint and return what came out.

    Raises:
        ConfigurationError: What is asked for runs on one joint only.
    """
    for name in ("policy", "experiment", "benchmark"):
        if getattr(options, name) is not None:
            raise ConfigurationError(
                f"--{name} runs on one joint, and {options.config} lists "
                f"{', '.join(config.name for config in configs)}. Name it: --joint NAME."
            )
    jobs = [
        tracking(config, argparse.Namespace(**{**vars(options), "seed": options.seed + APART * k}))
        for k, config in enumerate(configs)
    ]
    for job in jobs:
        if job.controller != NONE:
            choose(job.controller)  # a wrong name is told before the bus is touched
    facts = {config.name: job.facts for config, job in zip(configs, jobs, strict=True)}
    path = None if frames is not None else options.out
    with CanArm(configs, _link(configs, options, frames), path, runs=facts) as arm:
        arm.connect()
        laws = [
            _law(job, config, late)
            for job, config, late in zip(jobs, configs, arm.measured_delay(), strict=True)
        ]
        arm.arm()
        errors = _follow(arm, jobs, laws)
        arm.stop()
        timing = arm.joints[0].timing
    rmse = {
        config.name: None if law is None else float(np.sqrt(np.mean(np.square(error))))
        for config, law, error in zip(configs, laws, errors.T, strict=True)
    }
    return {**outcome(jobs[0], path, errors, timing, arm.dt), "joints": rmse}


def _law(job: Job, config: HardwareConfig, late: Mapping[str, float]) -> Controller | None:
    """Return the controller of a joint, and note its gains; None where the motor is commanded."""
    if job.controller == NONE:
        return None
    law = law_for(job.controller, config.joint, config.dt, late)
    job.facts["designed_for_s"] = late
    job.facts.update(gains_in_record(law))
    return law


def look_at(configs: Sequence[HardwareConfig]) -> dict[str, dict[str, float]]:
    """Return what the joints show, without moving them."""
    with CanArm(configs) as arm:
        arm.connect()
        return {joint.config.name: joint.nodes.values() for joint in arm.joints}


def _link(
    configs: Sequence[HardwareConfig], options: argparse.Namespace, frames: Frames | None
) -> VirtualLink | None:
    if not (options.dry_run or options.emulated):
        return None
    joints = [emulated_joint(c, {} if options.dry_run else None) for c in configs]
    link = VirtualLink(EmulatedArm(configs, joints))
    link.sent = frames
    return link


def _follow(arm: CanArm, jobs: Sequence[Job], laws: Sequence[Controller | None]) -> Any:
    """Run the controllers; return the tracking errors [N m], shape (samples, joints)."""
    references = np.stack([job.reference for job in jobs], axis=1)
    measured = arm.reset()
    for law, seen in zip(laws, measured, strict=True):
        if law is not None:
            law.act(seen, references[0, :1])  # what is compiled on first use is compiled now
            law.reset()
    errors = np.zeros(references.shape)
    for k, wanted in enumerate(references):
        errors[k] = wanted - [float(seen.tau[0]) for seen in measured]
        commands = [
            wanted[j] if law is None else float(law.act(seen, wanted[j : j + 1])[0])
            for j, (law, seen) in enumerate(zip(laws, measured, strict=True))
        ]
        shown = np.where([law is None for law in laws], np.nan, wanted)
        measured = arm.step(np.array(commands), shown)
    return errors
