"""`cjt-gym hardware`: a controller, policy or experiment on a joint on a CAN bus."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import Controller
from cjt_gym.canbus.config import HardwareConfig, load_joints
from cjt_gym.canbus.dry_run import Frames
from cjt_gym.canbus.emulator import Emulator, emulated_joint
from cjt_gym.canbus.experiments import EXPERIMENTS
from cjt_gym.canbus.link import Link
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.protocols.contract import CHANNELS
from cjt_gym.canbus.safety import HardwareFault
from cjt_gym.canbus.virtual import VirtualLink
from cjt_gym.commands.hardware_arm import look_at, run_arm
from cjt_gym.commands.hardware_jobs import NONE, TRACKING, Job, jobs_of
from cjt_gym.commands.hardware_law import law_for
from cjt_gym.commands.simulate import GAINS
from cjt_gym.console.controllers import CONTROLLER_HELP
from cjt_gym.console.endings import in_order
from cjt_gym.errors import ConfigurationError
from cjt_gym.signals import sampled_signal
from cjt_gym.training.tuning.gains import choose

Floats = NDArray[np.float64]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the joint, who moves it and how, and what keeps it still."""
    add = parser.add_argument
    add("config", type=Path, metavar="CONFIG.toml", help="the joint on its bus, as for emulate")
    add("--joint", metavar="NAME", help="which of the joints that it lists")
    who = parser.add_mutually_exclusive_group()
    text = f"{CONTROLLER_HELP}; a gain file; or {NONE}: the reference is the motor torque"
    who.add_argument("--controller", metavar="C", help=text)
    who.add_argument(
        "--policy",
        metavar="RUN",
        help="run folder, policy of  cjt-gym export --to numpy, or name of  cjt-gym policies",
    )
    text = f"identification experiments, all or: {', '.join(EXPERIMENTS)}; --out is a folder then"
    who.add_argument("--experiment", nargs="+", metavar="E", help=text)
    text = "step, chirp, multisine, smooth, or a record: its tau_ref is tracked, without one its "
    text += "command is replayed; default: chirp"
    add("--reference", default="chirp", help=text)
    add("--amplitude", type=float, help="of the reference [N m]; default: from the joint")
    add("--duration", type=float, help="[s]; default: that of the record, or 10")
    add("--seed", type=int, default=0, help="of the reference, default 0")
    add("--out", type=Path, metavar="RECORD", help="record to write, or folder for experiments")
    text = "run tasks of the benchmark, all or: step, chirp, multisine, smooth, and sweep for the "
    text += (
        "bandwidth; show the figures beside those of the nominal joint in simulation; --out is a "
    )
    text += "folder then"
    add("--benchmark", nargs="*", metavar="T", help=text)
    text = "further joints to simulate with --benchmark, such as the joint.toml of a diagnosis"
    add("--against", nargs="+", default=[], metavar="FILE.toml", help=text)
    add("--arm", action="store_true", help="really move the joint; without it nothing moves")
    text = "show the frames of a run against an emulated joint in this process; no bus is touched"
    add("--dry-run", action="store_true", help=text)
    text = "run against an emulated joint in this process, as fast as it goes; no bus is touched"
    add("--emulated", action="store_true", help=text)


def run(options: argparse.Namespace) -> None:
    """Run, write the record and say what came out."""
    logging.getLogger("can").setLevel(logging.ERROR)  # which warns of frames that come in pieces
    configs = load_joints(options.config, options.joint)
    if options.dry_run and options.emulated:
        raise ConfigurationError("Give --dry-run or --emulated, not both.")
    moves = options.arm or options.dry_run or options.emulated
    if not moves:
        _tell(options, _look(configs))
        return
    if options.out is None and not options.dry_run:
        raise ConfigurationError("--out must name the record to write, such as run.csv.")
    frames = Frames() if options.dry_run else None
    config = configs[0]
    with in_order():
        if len(configs) > 1:
            results = [run_arm(configs, options, frames)]
        else:
            results = [_run_one(config, options, job, frames) for job in jobs_of(config, options)]
    if frames is not None:
        text = ", ".join(f"{n} of {identifier:#x}" for identifier, n in frames.by_id.items())
        _tell(options, {"frames": frames.count, "by_id": text})
        return
    if options.benchmark is not None:
        _tell(options, {"records": results, "rows": _compare(config, options)})
        return
    _tell(options, results[0] if options.experiment is None else {"records": results})


def _compare(config: HardwareConfig, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Write and return the figures of the records beside those of simulations."""
    from cjt_gym.commands.hardware_benchmark import runs_of, side_by_side
    from cjt_gym.training.benchmark import write_rows

    paths = {name: options.out / f"{name}.csv" for name in runs_of(options.benchmark)}
    controller = options.controller or TRACKING
    rows = side_by_side(config, controller, options.policy, paths, options.against, options.seed)
    write_rows(rows, options.out)
    return rows


def _link(
    config: HardwareConfig, options: argparse.Namespace, frames: Frames | None
) -> Link | None:
    """Return a link to an emulator in this process, or None for the bus."""
    if not (options.dry_run or options.emulated):
        return None
    link = VirtualLink(Emulator(config, emulated_joint(config, {} if options.dry_run else None)))
    link.sent = frames
    return link


def _run_one(
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
    return {
        "record": None if path is None else str(path),
        "samples": len(job.reference),
        "rmse": float(np.sqrt(np.mean(np.square(error)))) if error else None,
        "timing_us": timing.summary(),
        "delays_s": timing.delay(plant.dt),
    }


def _law(plant: CanPlant, job: Job) -> Controller:
    """Return the controller of a job, its gains for the delay that is measured now."""
    delays = plant.measured_delay()
    law = law_for(job.controller, plant.config.joint, plant.dt, delays)
    gains = {name: getattr(law, name) for name in GAINS if hasattr(law, name)}
    plant.note(designed_for_s=delays, **gains)
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


def _look(configs: Sequence[HardwareConfig]) -> dict[str, Any]:
    """Return what the joint shows, or the joints, without moving anything."""
    if len(configs) > 1:
        return {"armed": False, "joints": look_at(configs)}
    with CanPlant(configs[0]) as plant:
        plant.connect()
        values = plant.nodes.values()
    return {"armed": False, "values": values}


def _tell(options: argparse.Namespace, result: dict[str, Any]) -> None:
    if options.json:
        sys.stdout.write(json.dumps(result) + "\n")
    elif "armed" in result:
        sys.stdout.write("Not armed, nothing was moved (--arm moves it). ")
        if "values" in result:
            sys.stdout.write(_shown(result["values"]) + "\n")
        else:
            lines = [f"{name}: {_shown(values)}" for name, values in result["joints"].items()]
            sys.stdout.write("\n" + "\n".join(lines) + "\n")
    elif "frames" in result:
        sys.stdout.write(f"{result['frames']} frames would be sent: {result['by_id']}\n")
    else:
        for one in result.get("records", [result]):
            sys.stdout.write(_line(one) + "\n")
        if "rows" in result:
            from cjt_gym.training.benchmark import table

            sys.stdout.write(table(result["rows"]) + "\n")


def _shown(values: Mapping[str, float]) -> str:
    named = sorted(values.items())
    return ", ".join(f"{name} {value:.6g} {CHANNELS[name][0]}" for name, value in named)


def _line(result: dict[str, Any]) -> str:
    how = f", tracking error {result['rmse']:.4g} N m rms" if result["rmse"] is not None else ""
    late = result["timing_us"].get("lateness", {})
    when = f"; commands late by {late['p50']:g} us (median), {late['p99.9']:g} us (99.9 %)"
    return f"{result['record']}: {result['samples']} samples{how}{when if late else ''}"
