"""The parameters of the box at which an agent is worst, by CMA-ES.

Hansen (2016), The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cjt_gym.envs.core import Episodes
from cjt_gym.training.benchmark.grid import Cell
from cjt_gym.training.evaluation.conditions import TASKS
from cjt_gym.training.evaluation.evaluate import first_seed
from cjt_gym.training.evaluation.rollout import Agent, drive, joint_of
from cjt_gym.training.evaluation.tasks import get_task
from experiments.results.shift import conditions_of, spelt_out

Floats = NDArray[np.float64]
STEPS: Final = 600
REFERENCES: Final = (*TASKS, "reversal")
SPREAD: Final = 0.3
"""First standard deviation of the search, over the range of each parameter."""


class Box:
    """The joints of the randomisation, side by side at places that are asked for.

    Every place meets the same episodes: references, starts and noise.

    Attributes:
        names: Of the parameters that vary.
        places: How many at once.
        episodes: Of each place.
    """

    def __init__(self, cell: Cell, agent: Agent, places: int, episodes: int) -> None:
        """Prepare the batch.

        Raises:
            ConfigurationError: The agent does not fit the joint.
        """
        usual = conditions_of(cell)
        once = {n: {**spelt_out(v), "when": "once"} for n, v in usual.randomization.items()}
        conditions = replace(usual, randomization=once)
        joint = joint_of(conditions)
        references = [get_task(task).setting(conditions, joint).reference for task in REFERENCES]
        arguments = agent.arguments(conditions)
        arguments |= {"reference": references, "episode_steps": STEPS}
        self.names, self.places, self.episodes = tuple(once), places, episodes
        self._agent, self._batch = agent, Episodes(places * episodes, **arguments)

    def errors(self, points: Floats, first: int) -> Floats:
        """Return the nrmse at places of the box, shape (places,) [-].

        Args:
            points: Quantiles of every parameter, shape (places, parameters), in [0, 1].
            first: Seed of the first episode; each place has `episodes` from there on.

        Raises:
            SimulationError: A state ceased to be finite.
        """
        plant = self._batch.plant
        for i in range(self._batch.num):
            plant.seed_one(i, first + i % self.episodes)
        plant.place(np.repeat(points, self.episodes, axis=0))
        run = drive(self._agent, self._batch)
        shape = (self.places, -1)
        squares, powers = (x.reshape(shape) ** 2 for x in (run.error, run.reference))
        return np.asarray(np.sqrt(squares.mean(axis=1) / powers.mean(axis=1)))

    def parameters(self) -> list[dict[str, float]]:
        """Return the values at the places of the last call."""
        drawn = self._batch.plant.drawn()
        rows = range(0, self._batch.num, self.episodes)
        return [{name: float(drawn[name][i]) for name in self.names} for i in rows]


def worst_case(cell: Cell, generations: int, places: int) -> dict[str, Any]:
    """Search the box of the benchmark's randomisation for where an agent is worst.

    The search sees `cell.episodes` episodes; what it finds is then judged on others, so that it
    is the place and not the episodes that is bad.

    Args:
        cell: The agent, its joint and structure, and how many episodes each place has.
        generations: Of CMA-ES.
        places: Places of each generation, all in one batch.

    Returns:
        nrmse at the middle of the box and at the worst place, "middle" and "worst", on unseen
        episodes; "where": the values there.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma
    box = Box(cell, cell.load(), places, cell.episodes)
    middle = np.full(len(box.names), 0.5)
    options = {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "popsize": places}
    strategy = cma.CMAEvolutionStrategy(middle, SPREAD, options)
    seen, unseen = first_seed("step", cell.seed + 1), first_seed("chirp", cell.seed + 1)
    worst, at = -np.inf, middle
    for _ in range(generations):
        points = np.clip(strategy.ask(), 0.0, 1.0)
        errors = box.errors(points, seen)
        strategy.tell(list(points), (-np.log(errors)).tolist())
        if errors.max() > worst:
            worst, at = float(errors.max()), points[np.argmax(errors)]
    # Half the batch at either place: as many unseen episodes as there is room for.
    half = places // 2
    sets = [unseen + k * cell.episodes for k in range(2)]
    both = np.array([at, middle] * half + [at] * (places % 2))
    squares = np.mean([box.errors(both, first)[:2] ** 2 for first in sets], axis=0)
    return {
        "worst": float(np.sqrt(squares[0])),
        "middle": float(np.sqrt(squares[1])),
        "where": box.parameters()[0],
    }
