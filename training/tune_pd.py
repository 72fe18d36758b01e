"""The search behind the defaults of `pd_feedforward`: `python -m cjt_gym.training.tune_pd`.

The gains follow from each joint's linear model (see `cjt_gym.baselines.pd_design`); two numbers
of that design remain to be chosen: the largest sensitivity, and the delay that the loop must bear
on top of what is known. Every pair of a grid is run on four joints, each with locked output, rigid
or compliant gearbox, and with a free load, under realistic effects, randomised parameters and a
command delay that varies from 0.5 to 3 ms though the design takes it for 1 ms, over the four
references of the benchmark. The score is the mean over all of them of the error over that of the
open loop in the same episodes; what makes any of them worse than `WORST` is not taken. The winner
is then run on joints that took no part.

Found with seed 77: peak 2 and spare delay 1 ms; see the table in `RESULT`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.baselines import PdFeedForward
from cjt_gym.baselines.pd_design import design_gains
from cjt_gym.baselines.pd_feedforward import CUTOFF_HZ
from cjt_gym.joint import Joint
from cjt_gym.plant import limits_of
from cjt_gym.training.conditions import TASKS, Conditions, realistic_conditions, task_reference
from cjt_gym.training.metrics import rmse
from cjt_gym.training.rollout import Agent, ControllerAgent, rollout

JOINTS = ("orange_80_6000", "lemon_50_6000", "avocado_100_21000", "pomegranate_160_9000")
HELD_OUT = ("orange_100_6000", "lime_50_21000", "example")
STRUCTURES = ("output_fixed_rigid_gearbox", "output_fixed", "rigid_gearbox")
DELAYS = {"low": 5e-4, "high": 3e-3, "operation": "set"}
PEAKS = (1.5, 2.0, 2.5, 3.0, 4.0)
SPARE_DELAYS = (0.0, 1e-3, 2e-3)
WORST = 1.5
EPISODES, STEPS, SEED = 8, 500, 77


@dataclass(frozen=True)
class PdAgent:
    """PD with feed-forward, designed with one candidate's numbers.

    Attributes:
        peak: Largest sensitivity.
        spare_delay: Delay that the loop must bear on top of the nominal one [s].
    """

    peak: float
    spare_delay: float
    name: str = "candidate"
    kind: str = "classical"

    def make(self, joint: Joint, dt: float) -> PdFeedForward:
        """Return the controller for a joint."""
        g = design_gains(joint, dt, CUTOFF_HZ, self.peak, self.spare_delay)
        limit = limits_of(joint).tau
        return PdFeedForward(g.kp, g.kd, dt, derivative=g.derivative, torque_limit=limit)

    def arguments(self, conditions: Conditions) -> dict[str, Any]:
        """Return the conditions with the controller as base."""
        return conditions.arguments | {"base_controller": self.make}

    def act(self, observation: NDArray[np.float32]) -> NDArray[Any]:
        """Return zeros: the controller acts alone."""
        return np.zeros((observation.shape[0], 1))


def scenarios(joints: Iterable[str]) -> list[Conditions]:
    """Return every joint in every structure, with delays up to 3 ms."""
    found = []
    for joint, structure in product(joints, STRUCTURES):
        usual = realistic_conditions(joint, structure)
        spec = {**usual.randomization, "command_delay.delay": DELAYS}
        found.append(replace(usual, randomization=spec))
    return found


def errors(agent: Agent, conditions: Conditions, seed: int) -> NDArray[np.float64]:
    """Return the rmse of each task [N m], shape (tasks,)."""
    references = [task_reference(task, conditions.amplitude) for task in TASKS]
    values = [rmse(rollout(agent, conditions, r, STEPS, EPISODES, seed)) for r in references]
    return np.array(values)


def relative_errors(agent: Agent, joints: Iterable[str], seed: int) -> NDArray[np.float64]:
    """Return errors over those of the open loop, shape (scenarios, tasks)."""
    open_loop = ControllerAgent("open_loop")
    cases = scenarios(joints)
    return np.array([errors(agent, c, seed) / errors(open_loop, c, seed) for c in cases])


def search(joints: Iterable[str], seed: int) -> list[tuple[float, float, PdAgent]]:
    """Return mean score, worst score and numbers of the candidates that pass, best first."""
    results = []
    for numbers in product(PEAKS, SPARE_DELAYS):
        agent = PdAgent(*numbers)
        ratios = relative_errors(agent, joints, seed)
        results.append((float(ratios.mean()), float(ratios.max()), agent))
        _report(*results[-1])
    return sorted((r for r in results if r[1] <= WORST), key=lambda r: r[0])


def _report(mean: float, worst: float, agent: PdAgent) -> None:
    sys.stderr.write(
        f"peak {agent.peak:.1f}  spare delay {1e3 * agent.spare_delay:.0f} ms:  error over open "
        f"loop: mean {mean:.3f}, worst {worst:.3f}\n"
    )
    sys.stderr.flush()


def main() -> None:
    """Search, and report the winner on the joints that took no part."""
    parser = argparse.ArgumentParser(description="Search the design numbers of pd_feedforward.")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of all draws")
    seed = parser.parse_args().seed
    mean, worst, winner = search(JOINTS, seed)[0]
    sys.stderr.write("best: ")
    _report(mean, worst, winner)
    ratios = relative_errors(winner, HELD_OUT, seed + 1000)
    sys.stderr.write("on joints that took no part: ")
    _report(float(ratios.mean()), float(ratios.max()), winner)


if __name__ == "__main__":
    main()
