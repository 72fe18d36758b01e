"""`cjt-gym hardware`: a controller, policy or experiment on a joint on a CAN bus."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cjt_gym.canbus.config import HardwareConfig, load_joints
from cjt_gym.canbus.dry_run import Frames
from cjt_gym.canbus.experiments import EXPERIMENTS
from cjt_gym.canbus.plant import CanPlant
from cjt_gym.canbus.protocols.contract import CHANNELS
from cjt_gym.console import Answer
from cjt_gym.console.controllers import CONTROLLER_HELP
from cjt_gym.console.endings import in_order
from cjt_gym.errors import ConfigurationError
from cjt_gym.hardware.jobs import NONE, TRACKING, jobs_of
from cjt_gym.hardware.one import run_one
from cjt_gym.hardware.several import look_at, run_arm


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


def run(options: argparse.Namespace) -> Answer:
    """Run, write the record and say what came out."""
    result = _run(options)
    return result, _words(result)


def _run(options: argparse.Namespace) -> dict[str, Any]:
    logging.getLogger("can").setLevel(logging.ERROR)  # which warns of frames that come in pieces
    configs = load_joints(options.config, options.joint)
    if options.dry_run and options.emulated:
        raise ConfigurationError("Give --dry-run or --emulated, not both.")
    moves = options.arm or options.dry_run or options.emulated
    if not moves:
        return _look(configs)
    if options.out is None and not options.dry_run:
        raise ConfigurationError("--out must name the record to write, such as run.csv.")
    frames = Frames() if options.dry_run else None
    config = configs[0]
    with in_order():
        if len(configs) > 1:
            results = [run_arm(configs, options, frames)]
        else:
            results = [run_one(config, options, job, frames) for job in jobs_of(config, options)]
    if frames is not None:
        text = ", ".join(f"{n} of {identifier:#x}" for identifier, n in frames.by_id.items())
        return {"frames": frames.count, "by_id": text}
    if options.benchmark is not None:
        return {"records": results, "rows": _compare(config, options)}
    return results[0] if options.experiment is None else {"records": results}


def _compare(config: HardwareConfig, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Write and return the figures of the records beside those of simulations."""
    from cjt_gym.hardware.beside_simulation import runs_of, side_by_side
    from cjt_gym.training.benchmark import write_rows

    paths = {name: options.out / f"{name}.csv" for name in runs_of(options.benchmark)}
    controller = options.controller or TRACKING
    rows = side_by_side(config, controller, options.policy, paths, options.against, options.seed)
    write_rows(rows, options.out)
    return rows


def _look(configs: Sequence[HardwareConfig]) -> dict[str, Any]:
    """Return what the joint shows, or the joints, without moving anything."""
    if len(configs) > 1:
        return {"armed": False, "joints": look_at(configs)}
    with CanPlant(configs[0]) as plant:
        plant.connect()
        values = plant.nodes.values()
    return {"armed": False, "values": values}


def _words(result: dict[str, Any]) -> str:
    if "armed" in result:
        lines = [f"\n{name}: {_shown(values)}" for name, values in result.get("joints", {}).items()]
        seen = _shown(result["values"]) if "values" in result else "".join(lines)
        return f"Not armed, nothing was moved (--arm moves it). {seen}"
    if "frames" in result:
        return f"{result['frames']} frames would be sent: {result['by_id']}"
    lines = [_line(one) for one in result.get("records", [result])]
    if "rows" in result:
        from cjt_gym.training.benchmark import table

        lines.append(table(result["rows"]))
    return "\n".join(lines)


def _shown(values: Mapping[str, float]) -> str:
    named = sorted(values.items())
    return ", ".join(f"{name} {value:.6g} {CHANNELS[name][0]}" for name, value in named)


def _line(result: dict[str, Any]) -> str:
    how = f", tracking error {result['rmse']:.4g} N m rms" if result["rmse"] is not None else ""
    late = result["timing_us"].get("lateness", {})
    when = f"; commands late by {late['p50']:g} us (median), {late['p99.9']:g} us (99.9 %)"
    return f"{result['record']}: {result['samples']} samples{how}{when if late else ''}"
