"""Environment steps per second, as ratios to Gymnasium's CartPole in the same run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

import cjt_gym  # noqa: F401  registers the environments
from benchmarks.report import Table
from benchmarks.timing import ratios
from cjt_gym.envs.sb3 import TorqueTrackingVecEnv

ID = "CJT/TorqueTracking-v0"
PLAIN: dict[str, Any] = {"effects": {}}
REAL: dict[str, Any] = {
    "effects": {
        "coulomb": {},
        "cogging": {"f": (80.0, 480.0), "a": (0.5, 0.2), "b": (0.2, 0.1)},
        "command_delay": {"delay": 1e-3},
        "measurement_delay": {"delay": 1e-3},
        "noise": {},
        "quantization": {},
        "velocity_differentiation": {"cutoff": 200.0},
    },
    "randomization": {"k_b": (0.9, 1.1), "d_m": (0.5, 2.0), "coulomb.d_cm": (0.5, 1.5)},
}
FRICTION: dict[str, Any] = {
    "structure": "full_dynamics",
    "effects": {"coulomb": {"dq_0": 0.002}, "cogging": REAL["effects"]["cogging"]},
}
SHARP: dict[str, Any] = {**FRICTION, "effects": {**FRICTION["effects"], "coulomb": {"dq_0": 0.0}}}
CASES = {"ideal": PLAIN, "friction": FRICTION, "sharp friction": SHARP, "all effects": REAL}
SINGLE_STEPS = 5_000
BATCH_STEPS = 1_000  # of every member: an episode and the beginning of the next


def single(env: gym.Env[Any, Any], steps: int) -> Callable[[], int]:
    """Return work that steps one environment with random actions drawn beforehand."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]

    def work() -> int:
        env.reset(seed=0)
        for k in range(steps):
            _, _, terminated, truncated, _ = env.step(actions[k % 64])
            if terminated or truncated:
                env.reset()
        return steps

    return work


def batch(env: gym.vector.VectorEnv[Any, Any, Any], steps: int) -> Callable[[], int]:
    """Return work that steps a batch; its unit is a step of one member."""
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(8)]
    env.reset(seed=0)

    def work() -> int:
        for k in range(steps):
            env.step(actions[k % 8])
        return steps * env.num_envs

    return work


def sb3_batch(num: int, arguments: dict[str, Any], steps: int) -> Callable[[], int]:
    """Return the same for the batch of Stable-Baselines3."""
    env = TorqueTrackingVecEnv(num, **arguments)
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1.0, 1.0, (num, 1)).astype(np.float32) for _ in range(8)]
    env.reset()

    def work() -> int:
        for k in range(steps):
            env.step(actions[k % 8])
        return steps * num

    return work


def works() -> dict[str, Callable[[], int]]:
    """Return everything that is compared with CartPole."""
    found: dict[str, Callable[[], int]] = {}
    for label, arguments in CASES.items():
        found[f"joint, {label}, gymnasium.make"] = single(gym.make(ID, **arguments), SINGLE_STEPS)
        for num in (64, 1024):
            env = gym.make_vec(ID, num_envs=num, **arguments)
            found[f"joint, {label}, make_vec of {num}"] = batch(env, BATCH_STEPS)
        if arguments is FRICTION:
            found[f"joint, {label}, VecEnv of 1024"] = sb3_batch(1024, arguments, BATCH_STEPS)
    return found


def table() -> Table:
    """Measure all environments in turns."""
    unit = single(gym.make("CartPole-v1"), SINGLE_STEPS)
    found = ratios(unit, works())
    rows = [[name, f"{cpu:.2f}", f"{clock:.2f}"] for name, (cpu, clock) in found.items()]
    return Table(
        "Speed",
        "Steps per second relative to `CartPole-v1` through `gymnasium.make` in the same run, by "
        "the CPU time of all threads (one core) and by the clock (all cores, shared with other "
        "programs); a step of a batch of n counts n times, and batches begin one new episode per "
        "1000 steps; medians of five rounds, CartPole before and after each. "
        "Control step 1 ms of ten substeps, orange_80_6000. Ideal and all effects: "
        "output_fixed_rigid_gearbox; friction: full_dynamics with Coulomb friction of motor and "
        "gear and two harmonics of cogging, smooth (dq_0 = 0.002 rad/s) or sharp (set-valued, "
        "dq_0 = 0). All: Coulomb friction, cogging, delays of command and measurement, noise, "
        "quantization, differentiated velocities, randomised parameters.",
        ["environment", "by CPU time", "by the clock"],
        rows,
    )
