"""One run of `cjt-gym hardware`: the joints of a bus, each with its controller or policy."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.baselines.gains import law_in_record
from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.journal import Watcher
from cjt_gym.canbus.link import Link
from cjt_gym.errors import HardwareError
from cjt_gym.hardware.delayed_law import PolicyLaw, designed_for, law_for
from cjt_gym.hardware.jobs import NONE, Job, Run
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.plant import Measurement
from cjt_gym.training.evaluation.metrics import rms

Law = Controller | PolicyLaw
"""What commands a joint."""
ALIKE, FEWEST = 0.9, 20
"""Least correlation of torque and deflection, over that many samples at least, from which their
signs can be told."""


def carry_out(
    run: Run, configs: Sequence[HardwareConfig], link: Link | None, watcher: Watcher | None
) -> dict[str, Any]:
    """Carry out a run and return its result; say where torque and angles contradict each other."""
    heard: list[Floats] = []
    remarks: list[str] = []
    try:
        result = _carry_out(run, configs, link, watcher, heard)
    except Exception as error:
        if heard and not isinstance(error, HardwareError):
            is_there = run.path is not None and run.path.exists()
            ended = f"{run.path} ends there" if is_there else "no record: no command was sent yet"
            sys.stderr.write(f"Torque is off; {ended}.\n")
        raise
    finally:  # a drive that pushes the wrong way may soon end in a fault
        remarks += _turned(configs, heard)
        for remark in remarks:
            sys.stderr.write(f"{remark}\n")
    return result | {"remarks": remarks}


def _carry_out(
    run: Run,
    configs: Sequence[HardwareConfig],
    link: Link | None,
    watcher: Watcher | None,
    heard: list[Floats],
) -> dict[str, Any]:
    with CanArm(configs, link, run.path, watcher) as arm:
        policies = [_policy(arm, k, job) for k, job in enumerate(run.jobs)]  # before the bus
        arm.connect()
        delays = arm.measured_delays() if None in policies else []
        laws = [law or _law(arm, k, run.jobs[k], delays[k]) for k, law in enumerate(policies)]
        arm.arm()
        sys.stderr.write(f"{run.title}: {len(run.jobs[0].reference) * arm.dt:g} s\n")
        errors = _follow(arm, run.jobs, laws, heard)
        arm.stop()
        timing = arm.joints[0].timing
    tracked = [law is not None for law in laws]
    result = {
        "record": None if run.path is None else str(run.path),
        "samples": len(errors),
        "rmse": rms(errors[:, tracked]) if any(tracked) else None,
        "timing_us": timing.summary(),
        "delays_s": timing.delay(arm.dt),
    }
    if len(configs) == 1:
        return result
    each = zip(configs, tracked, errors.T, strict=True)
    return result | {"joints": {c.name: rms(error) if is_on else None for c, is_on, error in each}}


def _policy(arm: CanArm, k: int, job: Job) -> Law | None:
    """Return the policy of a joint, or None; add the task to the record's provenance."""
    arm.joints[k].record.know(**job.facts)
    return None if job.policy is None else PolicyLaw(job.policy, arm, k, job.reference)


def _law(arm: CanArm, k: int, job: Job, delays: Mapping[str, float]) -> Law | None:
    """Return the controller of a joint, or None; add its gains to the record's provenance.

    Gains are designed for the measured delays [s].
    """
    joint = arm.joints[k]
    if job.controller == NONE:
        return None
    given = job.controller, joint.config.joint, arm.dt, delays
    law = law_for(*given)
    joint.record.know(designed_for_s=delays, **law_in_record(*designed_for(*given), law))
    return law


def _turned(configs: Sequence[HardwareConfig], heard: Sequence[Floats]) -> list[str]:
    """Return a remark for every joint whose torque falls where its spring's deflection rises."""
    found: list[str] = []
    if len(heard) < FEWEST:
        return found
    for config, (torque, twist) in zip(configs, np.array(heard).T, strict=True):
        is_moved = np.ptp(torque) > 0.0 and np.ptp(twist) > 0.0
        if is_moved and np.corrcoef(torque, twist)[0, 1] < -ALIKE:
            found.append(
                f"The measured torque of {config.name or config.origin} falls where the deflection "
                "of its spring rises: a sign is wrong. Check `sign` of the drive under [drive] and "
                "of the sensors under [sensors]."
            )
    return found


def _spring(measured: Sequence[Measurement]) -> Floats:
    """Return torques [N m] and deflections [rad], shape (2, joints)."""
    return np.array([[m.tau[0] for m in measured], [m.q_g[0] - m.q_l[0] for m in measured]])


def _follow(
    arm: CanArm, jobs: Sequence[Job], laws: Sequence[Law | None], heard: list[Floats]
) -> Floats:
    """Run the joints; return the tracking errors [N m], shape (samples, joints).

    What is `heard`, torque [N m] and deflection [rad] of shape (2, joints), is added step by step.
    """
    references = np.stack([job.reference for job in jobs], axis=1)
    wanted = np.where([law is None for law in laws], np.nan, references)
    measured = arm.reset()
    heard.append(_spring(measured))
    for k, (law, seen) in enumerate(zip(laws, measured, strict=True)):
        if law is not None:
            law.act(seen, references[0, k : k + 1])  # what is compiled on first use is compiled now
            law.reset()
    errors = np.zeros(references.shape)
    for step, row in enumerate(references):
        errors[step] = row - heard[-1][0]
        commands = [
            row[k] if law is None else law.act(seen, row[k : k + 1])[0]
            for k, (law, seen) in enumerate(zip(laws, measured, strict=True))
        ]
        measured = arm.step(np.array(commands), wanted[step])
        heard.append(_spring(measured))
    return errors
