"""`cjt-gym emulate`: a drive with a simulated joint behind it, on a CAN bus."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

from cjt_gym.canbus.config import HardwareConfig, load_joints
from cjt_gym.canbus.emulated_arm import emulator_of, serve
from cjt_gym.canbus.emulator import emulated_joint
from cjt_gym.canbus.hidden_effects import draw_hidden
from cjt_gym.canbus.link import quiet_machine
from cjt_gym.canbus.ports import Port, open_port
from cjt_gym.console.endings import ending_signals
from cjt_gym.console.options import asked_effects, check_seed, check_time
from cjt_gym.disk import write_text
from cjt_gym.errors import ConfigurationError, check_range
from cjt_gym.joint import EFFECTS, Joint

WARM_UP = 0.1
"""Time of the joint that passes before it is served, so that all code is compiled [s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which joint, what it hides, and how bus and clock behave."""
    add = parser.add_argument
    add("config", type=Path, metavar="CONFIG.toml", help="the joint on its bus, as for hardware")
    add("--joint", metavar="NAME", help="which of the joints that it lists")
    text = "seed from which hidden effects are drawn, for a blind diagnosis"
    add("--hidden-seed", type=int, metavar="N", help=text)
    text = "write what the joint really has to this JSON file, to look at afterwards"
    add("--truth", type=Path, metavar="FILE", help=text)
    text = "effects instead of the file's: name, name=typical or name.parameter=value "
    text += f"({', '.join(EFFECTS)})"
    add("--effect", nargs="+", metavar="E", help=text)
    add("--speed", type=float, help="speed of simulated time relative to the clock, default 1")
    add("--latency", type=float, help="latency of every frame [s], default 0")
    add("--jitter", type=float, help="mean of an additional random latency [s], default 0")
    add("--loss", type=float, help="fraction of frames that are lost, default 0")
    add("--load", type=float, help="fraction of the bus that other nodes occupy, default 0")
    add("--seed", type=int, help="seed of sensor noise, latency and loss, default 0")
    add("--seconds", type=float, help="stop after this time [s]; default: on Ctrl-C")


def run(options: argparse.Namespace) -> None:
    """Serve until it is stopped."""
    check_seed(options.seed)
    check_time("seconds", options.seconds)
    configs = [with_options(c, options) for c in load_joints(options.config, options.joint)]
    config = configs[0]
    check_seed(options.hidden_seed, "hidden-seed")
    if options.hidden_seed is not None and options.effect is not None:
        raise ConfigurationError("Give --hidden-seed or --effect, not both.")
    joints = [_emulated(each, options, k) for k, each in enumerate(configs)]
    if options.truth is not None:
        truth: Any = {c.name: joint.effects for c, joint in zip(configs, joints, strict=True)}
        truth = truth if len(configs) > 1 else joints[0].effects
        write_text(options.truth, json.dumps(truth, indent=1) + "\n")
    port = open_port(config.bus)
    try:
        facts = [
            _facts(options, each, port, list(joint.effects))
            for each, joint in zip(configs, joints, strict=True)
        ]
        _announce(options, facts)
        emulator = emulator_of(configs, joints)
        stopped = _until(options.seconds)
        emulator.advance(WARM_UP)
        with quiet_machine(config.priority):
            serve(emulator, port, config.emulator.speed, stopped)
    finally:
        port.close()


def with_options(config: HardwareConfig, options: argparse.Namespace) -> HardwareConfig:
    """Return a configuration whose emulator behaves as the options say."""
    names = ("speed", "latency", "jitter", "loss", "load", "seed")
    given = {name: getattr(options, name) for name in names if getattr(options, name) is not None}
    for name, value in given.items():
        top = 0.95 if name in ("loss", "load") else 1.0 if name in ("latency", "jitter") else 1e6
        low, above = (-inf, 0.0) if name == "speed" else (0.0, -inf)
        check_range(f"--{name}", value, low=low, above=above, high=top)
    return replace(config, emulator=replace(config.emulator, **given))


def _emulated(config: HardwareConfig, options: argparse.Namespace, k: int) -> Joint:
    """Return the joint that is emulated, the k-th of all."""
    effects: Any = asked_effects(options)
    if options.hidden_seed is not None:
        effects = draw_hidden(config.joint, options.hidden_seed + k)
    return emulated_joint(config, effects)


def _facts(
    options: argparse.Namespace, config: HardwareConfig, port: Port, effects: list[str]
) -> dict[str, Any]:
    """Return where a drive is, and, unless that is hidden, what its joint has."""
    known: dict[str, Any] = {"name": config.name} if config.name else {}
    return known | {
        "address": port.address,
        "protocol": config.drive.protocol,
        "node": config.drive.settings.node,
        "joint": config.joint.parameters.name,
        "effects": None if options.hidden_seed is not None else effects,
    }


def _announce(options: argparse.Namespace, joints: Sequence[dict[str, Any]]) -> None:
    """Say where the drives are, and what their joints have."""
    if options.json:
        facts: Any = joints[0] if len(joints) == 1 else {"joints": joints}
        sys.stdout.write(json.dumps(facts) + "\n")
    else:
        for facts in joints:
            known = facts["effects"]
            what = "hidden" if known is None else ", ".join(known) or "none"
            sys.stdout.write(
                f"{facts['joint']} behind {facts['protocol']} node {facts['node']} on "
                f"{facts['address']}; effects: {what}. Press Ctrl-C to stop.\n"
            )
    sys.stdout.flush()


def _until(seconds: float | None) -> Callable[[], bool]:
    """Return a function that says whether to stop: time is up, or a signal came."""
    stopped = False

    def stop(number: int, frame: object) -> None:
        nonlocal stopped
        stopped = True

    for number in ending_signals():
        signal.signal(number, stop)
    end = inf if seconds is None else time.monotonic() + seconds
    return lambda: stopped or time.monotonic() >= end
