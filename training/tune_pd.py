"""The search behind the gains of `pd_feedforward`: `python -m cjt_gym.training.tune_pd`.

For each joint and structure, a grid of (kp, damping ratio of the derivative, derivative of error
or output) is run under realistic effects, randomised parameters and a command delay that varies
from 0.5 to 3 ms, over the four references of the benchmark. Only gains count with which the linear
joint, without the help of friction, is stable at a loop delay of 2 ms and of 3 ms, and that
amplify the torque sensor's noise less than eightfold. The score is the error over that of the open
loop in the same episodes, mean over the references. The winner is scored again on other seeds,
and printed as a row of `cjt_gym.baselines.tuned_gains` if it still beats the design from the
linear model.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import PdFeedForward
from cjt_gym.baselines.pd_design import NOISE, SPARE_DELAY, design_gains, make_loop
from cjt_gym.baselines.pd_feedforward import CUTOFF_HZ
from cjt_gym.baselines.tuned_gains import TUNED_DT, Gains
from cjt_gym.joint import Joint, joint_names
from cjt_gym.plant import limits_of
from cjt_gym.training.conditions import TASKS, Conditions, realistic_conditions, task_reference
from cjt_gym.training.metrics import rmse
from cjt_gym.training.rollout import Agent, ControllerAgent, joint_of, rollout

STRUCTURES = ("output_fixed_rigid_gearbox", "output_fixed", "rigid_gearbox", "full_dynamics")
DELAYS = {"low": 5e-4, "high": 3e-3, "operation": "set"}
KP = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0)
DAMPING = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
DERIVATIVES = ("error", "output")
EPISODES, STEPS, SEED = 8, 500, 77
CHECK = 1000


@dataclass(frozen=True)
class GainsAgent:
    """PD with feed-forward and given gains."""

    gains: Gains
    name: str = "candidate"
    kind: str = "classical"
    trained_on: tuple[str, str] | None = None

    def make(self, joint: Joint, dt: float) -> PdFeedForward:
        """Return the controller for a joint."""
        g, limit = self.gains, limits_of(joint).tau
        return PdFeedForward(g.kp, g.kd, dt, derivative=g.derivative, torque_limit=limit)

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the controller as base."""
        return conditions.arguments | {"base_controller": self.make}

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return zeros: the controller acts alone."""
        return np.zeros((observation.shape[0], 1))


def tuning_conditions(joint: str, structure: str) -> Conditions:
    """Return realistic conditions with delays up to 3 ms."""
    usual = realistic_conditions(joint, structure)
    spec = {**usual.randomization, "command_delay.delay": DELAYS}
    return replace(usual, randomization=spec)


def candidates(joint: Joint) -> Iterator[Gains]:
    """Give the gains of the grid that are stable and quiet."""
    p = joint.parameters
    loop = make_loop(joint, TUNED_DT, CUTOFF_HZ, SPARE_DELAY)
    unit = 2.0 * math.sqrt((p.I_m + p.get("I_g", 0.0)) / p.k_b)
    for kp, damping in product(KP, DAMPING):
        kd = float(f"{damping * unit:.4g}")
        if loop.is_robust(kp, kd) and loop.noise(kp, kd) <= NOISE:
            for derivative in DERIVATIVES if kd > 0.0 else DERIVATIVES[:1]:
                yield Gains(kp, kd, derivative)


def errors(agent: Agent, conditions: Conditions, seed: int) -> NDArray[np.float64]:
    """Return the rmse of each task [N m], shape (tasks,)."""
    references = [task_reference(task, conditions.amplitude) for task in TASKS]
    values = [rmse(rollout(agent, conditions, r, STEPS, EPISODES, seed)) for r in references]
    return np.array(values)


def tune(name: str, structure: str, seed: int) -> tuple[Gains, float, float]:
    """Return the best gains, their score and that of the designed gains on other seeds."""
    conditions = tuning_conditions(name, structure)
    joint, open_loop = joint_of(conditions), ControllerAgent("open_loop")
    base = errors(open_loop, conditions, seed)
    scored = [
        (float(np.mean(errors(GainsAgent(gains), conditions, seed) / base)), k, gains)
        for k, gains in enumerate(candidates(joint))
    ]
    best = min(scored)[2]
    base = errors(open_loop, conditions, seed + CHECK)
    designed = design_gains(joint, TUNED_DT, CUTOFF_HZ)
    checks = [
        float(np.mean(errors(GainsAgent(g), conditions, seed + CHECK) / base))
        for g in (best, designed)
    ]
    return best, checks[0], checks[1]


def main() -> None:
    """Search for every joint and structure, and print the rows of the table."""
    parser = argparse.ArgumentParser(description="Search the gains of pd_feedforward.")
    parser.add_argument("joints", nargs="*", help="joints, all rotary ones if none is named")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of all draws")
    arguments = parser.parse_args()
    names = arguments.joints or [name for name in joint_names() if name != "emps"]
    for name, structure in product(names, STRUCTURES):
        gains, score, designed = tune(name, structure, arguments.seed)
        sys.stderr.write(
            f"{name} {structure}: error over open loop {score:.3f}, as designed {designed:.3f}\n"
        )
        if score < min(designed, 1.0):
            sys.stdout.write(
                f'    ("{name}", "{structure}"): '
                f'Gains({gains.kp:g}, {gains.kd:g}, "{gains.derivative}"),\n'
            )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
