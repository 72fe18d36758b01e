"""`cjt-gym warm-up`: compile everything once, with a line for each part."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from cjt_gym.blind.case import draw_case
from cjt_gym.console import Answer
from cjt_gym.envs.core import Episodes
from cjt_gym.envs.foreign import ForeignEpisode
from cjt_gym.gap import diagnose
from cjt_gym.joint import STRUCTURES, load_joint
from cjt_gym.plant import SimulatedPlant
from cjt_gym.records import Record, read_record
from cjt_gym.signals import make_signals

JOINT, STRUCTURE = "orange_80_6000", "output_fixed_rigid_gearbox"
POLICY = "quiet_residual"
EFFECTS = {"coulomb": {}, "noise": {}, "command_delay": {"delay": 1e-3}}
SAMPLES, DIAGNOSED = 20, 2000  # few, as compiling takes the time; a fit needs motion


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing."""


def run(options: argparse.Namespace) -> Answer:
    """Run every kind of compiled code on something small."""
    begun, seconds = time.monotonic(), {}
    for k, (name, part) in enumerate(PARTS.items(), 1):
        sys.stderr.write(f"{k}/{len(PARTS)} {name}\n")
        start = time.monotonic()
        part()
        seconds[name] = round(time.monotonic() - start, 2)
    total = time.monotonic() - begun
    lines = [f"  {name}: {number:.1f} s" for name, number in seconds.items()]
    text = "\n".join([f"Everything is compiled, after {total:.0f} s:", *lines])
    return {"seconds": seconds, "total": round(total, 2)}, text


def _record(samples: int, effects: Any) -> Record:
    """Return a motion of the joint under a growing sine."""
    t = 1e-3 * np.arange(samples)
    torque = 30.0 * (1.0 + t) * np.sin(2.0 * np.pi * 5.0 * t)
    return load_joint(JOINT, STRUCTURE, effects=effects).simulate(torque)


def _joints() -> None:
    _record(SAMPLES, EFFECTS)
    for structure in STRUCTURES:
        plant = SimulatedPlant(load_joint(JOINT, structure, effects=EFFECTS), 1)
        plant.reset(seed=0)
        plant.step(np.zeros(1))
    plant.batch.use_blocks(plant.joint)
    plant.step(np.zeros(1))
    episodes = Episodes(1, joint=JOINT)  # as those of a joint on a bus
    ForeignEpisode(episodes).rehearse()
    for signal in make_signals("mixed", 1.0):
        signal.reset(np.random.default_rng(0)).torque(np.zeros(SAMPLES))


def _environments() -> None:
    drifting = {"low": 0.5, "high": 2.0, "when": "interval", "interval": 2e-3}
    arguments: dict[str, Any] = {"effects": EFFECTS, "episode_steps": SAMPLES // 2}
    random = {"k_b": (0.9, 1.1), "coulomb.d_cm": drifting}
    general = {"effects": {"presliding": "typical"}}  # for which the kernel has no vectors
    for change in ({}, {"randomization": random}, general):
        given = {**arguments, **change}
        envs = gym.make_vec("CJT/TorqueTracking-v0", num_envs=9, **given)
        single = gym.make("CJT/TorqueTracking-v0", base_controller="pd", **given)
        for env in (envs, single):
            env.reset(seed=0)
            for _ in range(SAMPLES // 2):
                env.step(env.action_space.sample())
            env.reset()


def _policies() -> None:
    from cjt_gym.training.deploy.exported import load_exported
    from cjt_gym.training.deploy.shipped import policy_path
    from cjt_gym.training.deploy.stepper import Stepper

    policy = load_exported(policy_path(POLICY))
    policy.network.act(np.zeros(policy.layout.size, np.float32))
    Stepper(policy).step([0.0] * (policy.layout.preview + 1), *[0.0] * 7)


def _diagnosis() -> None:
    diagnose(read_record("emps").slice(0, DIAGNOSED))
    locked = load_joint(JOINT, STRUCTURE, effects=["noise"])
    hidden: dict[str, Any] = {"coulomb": {}, "spring_hysteresis": "typical"}
    for name, values in hidden.items():
        record = _record(DIAGNOSED, {"noise": {}, name: values})
        diagnose([record], locked.file, STRUCTURE)


PARTS: dict[str, Callable[[], object]] = {
    "joints": _joints,
    "environments": _environments,
    "policies": _policies,
    "diagnosis": _diagnosis,
    "blind tests": lambda: draw_case(0),
}
"""What is compiled, in this order."""
