"""`cjt-gym hardware` for one joint: a controller, a policy or an experiment on it."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from cjt_gym.baselines import Controller
from cjt_gym.canbus.config import HardwareConfig
from cjt_gym.canbus.dry_run import Frames
from cjt_gym.canbus.emulator import Emulator, emulated_joint
from cjt_gym.canbus.link import Link
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.hardware.delayed_law import law_for
from cjt_gym.hardware.jobs import NONE, Job, outcome
from cjt_gym.signals import sampled_signal
from cjt_gym.training.tuning.gains import choose, gains_in_record


def run_one(
    config: HardwareConfig, options: argparse.Namespace, job: Job, frames: Frames | None
) -> dict[str, Any]:
    """Run one job and return what came out."""
    if job.policy is None and job.controller != NONE:
        choose(job.controller)  # a wrong name is told before the bus is touched
    path = None if frames is not None else job.path
    plant = CanPlant(config, _link(config, options, frames), path, **job.facts)
    with plant:
        plant.connect()
        law = None
        if job.policy is None and job.controller != NONE:
            law = _law(plant, job)
        plant.arm()
        error = _follow(plant, job, law) if job.policy is None else _follow_policy(plant, job)
        plant.stop()
        timing = plant.timing
    return outcome(job, path, np.array(error), timing, plant.dt)


def _link(
    config: HardwareConfig, options: argparse.Namespace, frames: Frames | None
) -> Link | None:
    """Return a link to an emulator in this process, or None for the bus."""
    if not (options.dry_run or options.emulated):
        return None
    link = VirtualLink(Emulator(config, emulated_joint(config, {} if options.dry_run else None)))
    link.sent = frames
    return link


def _law(plant: CanPlant, job: Job) -> Controller:
    """Return the controller of a job, its gains for the delay that is measured now."""
    delays = plant.measured_delay()
    law = law_for(job.controller, plant.config.joint, plant.dt, delays)
    plant.note(designed_for_s=delays, **gains_in_record(law))
    return law


def _follow(plant: CanPlant, job: Job, law: Any) -> list[float]:
    """Run a controller, or command the reference itself; return the tracking errors [N m]."""
    reference = job.reference
    measured = plant.reset()
    if law is None:
        for torque in reference:
            plant.step(np.array([torque]))
        return []
    law.act(measured, reference[:1])  # what is compiled on first use is compiled now
    law.reset()
    errors = []
    for k in range(len(reference)):
        wanted = reference[k : k + 1]
        errors.append(float(wanted[0] - measured.tau[0]))
        measured = plant.step(law.act(measured, wanted), float(wanted[0]))
    return errors


def _follow_policy(plant: CanPlant, job: Job) -> list[float]:
    """Run a policy; return the tracking errors [N m]."""
    from cjt_gym.envs.hardware import HardwareEnv
    from cjt_gym.training.deploy.exported import Exported
    from cjt_gym.training.deploy.load_agent import load_agent
    from cjt_gym.training.evaluation.conditions import Conditions

    assert job.policy is not None
    agent = load_agent(job.policy)
    config = plant.config
    conditions = Conditions(config.joint_name, config.joint.structure, dt_control=config.dt)
    t = np.arange(len(job.reference), dtype=np.float64) * config.dt
    arguments = agent.arguments(conditions) | {"reference": sampled_signal(t, job.reference)}
    arguments["episode_steps"] = len(job.reference) + 1
    act = agent.network.act if isinstance(agent, Exported) else _without_torch(agent)
    with HardwareEnv(plant=plant, **arguments) as env:
        act(env.reset()[0])  # once before it counts
        observation, _ = env.reset()
        errors = []
        for _ in job.reference:
            observation, _, terminated, _, info = env.step(act(observation))
            if terminated and plant.guard.fault is not None:
                raise HardwareFault(plant.guard.fault)
            errors.append(info["tau_reference"] - info["tau"])
    return errors


def _without_torch(agent: Any) -> Any:
    from cjt_gym.training.deploy.fast_policy import fast_policy

    return fast_policy(agent)
