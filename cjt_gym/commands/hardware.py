"""`cjt-gym hardware`: a controller, policy or experiment on a joint on a CAN bus."""

from __future__ import annotations

import argparse
import contextlib
import logging
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cjt_gym.baselines.table import CONTROLLER_HELP
from cjt_gym.canbus.arm import CanArm
from cjt_gym.canbus.config import HardwareConfig, load_joints
from cjt_gym.canbus.emulated_arm import emulator_of
from cjt_gym.canbus.emulator import emulated_joint
from cjt_gym.canbus.experiments import EXPERIMENTS
from cjt_gym.canbus.journal import Watcher
from cjt_gym.canbus.protocols.contract import CHANNELS
from cjt_gym.canbus.virtual import Frames, VirtualLink
from cjt_gym.console import Answer
from cjt_gym.console.endings import in_order
from cjt_gym.errors import ConfigurationError
from cjt_gym.hardware.jobs import NONE, TRACKING, of_joint, runs_of
from cjt_gym.hardware.run import carry_out

EACH = "give it once for all joints, or once for each"
LIVE = 8765
"""TCP port of the live view, where none is given: the one at which Foxglove looks first."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the joint, what moves it and how, and what keeps it still."""
    add = parser.add_argument
    add("config", type=Path, metavar="CONFIG.toml", help="the joint on its bus, as for emulate")
    add("--joint", metavar="NAME", help="which of the joints that it lists")
    who = parser.add_mutually_exclusive_group()
    text = f"{CONTROLLER_HELP}; a gain file; or {NONE}: the reference is the motor torque"
    who.add_argument("--controller", action="append", metavar="C", help=f"{text}; {EACH}")
    text = "run folder, policy of  cjt-gym export --to numpy, or name of  cjt-gym policies"
    who.add_argument("--policy", action="append", metavar="RUN", help=f"{text}; {EACH}")
    text = f"identification experiments, all or: {', '.join(EXPERIMENTS)}; --out is a folder then"
    who.add_argument("--experiment", nargs="+", metavar="E", help=text)
    text = "step, chirp, multisine, smooth, or a record: its tau_ref is tracked, without one its "
    text += "command is replayed; default: chirp"
    add("--reference", default="chirp", help=text)
    add("--amplitude", type=float, help="amplitude of the reference [N m]; default: from the joint")
    add("--duration", type=float, help="duration [s]; default: that of the record, or 10")
    add("--seed", type=int, default=0, help="seed of the reference, default 0")
    add("--out", type=Path, metavar="RECORD", help="record to write, or folder for experiments")
    text = "run tasks of the benchmark, all or: step, chirp, multisine, smooth, and sweep for the "
    text += (
        "bandwidth; show the figures beside those of the nominal joint in simulation; --out is a "
    )
    text += "folder then"
    add("--benchmark", nargs="*", metavar="T", help=text)
    text = "further joints to simulate with --benchmark, such as the joint.toml of a diagnosis"
    add("--against", nargs="+", default=[], metavar="FILE.toml", help=text)
    add("--arm", action="store_true", help="move the joint; without this option nothing moves")
    text = "show the frames of a run against an emulated joint in this process; no bus is touched"
    add("--dry-run", action="store_true", help=text)
    text = "run against an emulated joint in this process, as fast as it goes; no bus is touched"
    add("--emulated", action="store_true", help=text)
    text = "show the run live in Foxglove; PORT of this machine, default "
    add("--live", nargs="?", type=int, const=LIVE, metavar="PORT", help=f"{text}{LIVE}")


def run(options: argparse.Namespace) -> Answer:
    """Run, write the record and say what came out."""
    result = _run(options)
    return result, _words(result)


def _run(options: argparse.Namespace) -> dict[str, Any]:
    # python-can warns of frames that come in pieces, and prints tracebacks of what is told here
    logging.getLogger("can").setLevel(logging.CRITICAL)
    configs = load_joints(options.config, options.joint)
    if options.dry_run and options.emulated:
        raise ConfigurationError("Give --dry-run or --emulated, not both.")
    moves = options.arm or options.dry_run or options.emulated
    if options.live is not None and (options.dry_run or not moves):
        raise ConfigurationError("--live shows a run: give --arm or --emulated, too.")
    if not moves:
        return _look(configs)
    if options.out is None and not options.dry_run:
        raise ConfigurationError("--out must name the record to write, such as run.csv.")
    for config in configs:
        _tell_free(config)
    frames = Frames() if options.dry_run else None
    with in_order(), _watched(options, configs) as watcher:
        results = [
            carry_out(one, configs, _link(configs, options, frames), watcher)
            for one in runs_of(configs, options)
        ]
    if frames is not None:
        text = ", ".join(f"{n} of {identifier:#x}" for identifier, n in frames.by_id.items())
        return {"frames": frames.by_id.total(), "by_id": text}
    if options.benchmark is not None:
        return {"records": results, "rows": _compare(configs, options)}
    return results[0] if options.experiment is None else {"records": results}


def _tell_free(config: HardwareConfig) -> None:
    """Say it where nothing limits how far a joint turns."""
    if math.isinf(config.limits.q_high) and not config.joint.structure_row.output_fixed:
        sys.stderr.write(
            f"The output of {config.joint_name} is free and q_m has no limit: it turns as far as "
            "its torque takes it. A range q_m in [limits] ends a run there.\n"
        )


@contextlib.contextmanager
def _watched(
    options: argparse.Namespace, configs: Sequence[HardwareConfig]
) -> Iterator[Watcher | None]:
    """Serve the live view during the runs, if requested."""
    if options.live is None:
        yield None
        return
    from cjt_gym.canbus.live import LiveView

    with LiveView(configs, options.live) as view:
        sys.stderr.write(f"Live at {view.address}; open it in Foxglove: {view.link}\n")
        yield view


def _compare(
    configs: Sequence[HardwareConfig], options: argparse.Namespace
) -> list[dict[str, Any]]:
    """Write and return the figures of the records beside those of simulations."""
    from cjt_gym.hardware.beside_simulation import side_by_side, tasks_of
    from cjt_gym.training.benchmark import write_rows

    paths = {name: options.out / f"{name}.csv" for name in tasks_of(options.benchmark)}
    rows = []
    for k, config in enumerate(configs):
        own = of_joint(options, k, configs)
        controller = own.controller or TRACKING
        found = side_by_side(config, controller, own.policy, paths, options.against, options.seed)
        mark = f"{config.name}: " if len(configs) > 1 else ""
        rows += [{**row, "where": mark + row["where"]} for row in found]
    write_rows(rows, options.out)
    return rows


def _link(
    configs: Sequence[HardwareConfig], options: argparse.Namespace, frames: Frames | None
) -> VirtualLink | None:
    """Return a link to an emulator in this process, or None for the bus."""
    if not (options.dry_run or options.emulated):
        return None
    joints = [emulated_joint(config, {} if options.dry_run else None) for config in configs]
    link = VirtualLink(emulator_of(configs, joints))
    link.sent = frames
    return link


def _look(configs: Sequence[HardwareConfig]) -> dict[str, Any]:
    """Return what the joints show, without moving anything."""
    with CanArm(configs) as arm:
        arm.connect()
        values = {joint.config.name: joint.nodes.values() for joint in arm.joints}
    if len(configs) > 1:
        return {"armed": False, "joints": values}
    return {"armed": False, "values": values[configs[0].name]}


def _words(result: dict[str, Any]) -> str:
    if "armed" in result:
        lines = [f"\n{name}: {_shown(values)}" for name, values in result.get("joints", {}).items()]
        seen = _shown(result["values"]) if "values" in result else "".join(lines)
        return f"Not armed, nothing was moved (add --arm to move the joint). {seen}"
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
