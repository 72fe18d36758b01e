"""Ranking of agents, and whether differences exceed chance.

All agents meet the same episodes, so that they are compared in pairs. The score of an agent is its
nrmse, geometric mean over the tasks that all have. Episodes are drawn anew with replacement, the
same for all agents (Efron, Tibshirani, 1993, An Introduction to the Bootstrap). A difference counts
if it is larger, in standard errors, than what the largest of all differences reaches by chance in
95 % of the draws (Romano, Wolf, 2005, Econometrica 73(4)): so many comparisons are allowed for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.training.evaluation.metrics import RESAMPLES

LEVEL = 0.95  # of all comparisons together
TINY = 1e-12  # standard error that stands for none


@dataclass(frozen=True)
class Place:
    """Where an agent stands."""

    # one more than the agents that are significantly better, and no less than the rank of one with
    # a better score; equal ranks are ties
    rank: int
    agent: str
    score: float  # nrmse, geometric mean over the tasks [-]
    low: float  # low end of the 95 % interval of the score
    high: float  # high end
    to_next: float | None  # ratio of its score to that of the next in order; None for the last
    to_next_low: float | None  # low end of the 95 % interval of the ratio, by itself
    to_next_high: float | None  # high end
    # whether the next is significantly worse, all comparisons allowed for; None for the last, and
    # where there is a single episode
    next_is_worse: bool | None


def rank(
    squares: Mapping[str, Mapping[str, Sequence[float]]],
    powers: Mapping[str, Mapping[str, Sequence[float]]],
) -> list[Place]:
    """Return the agents in order of their score.

    By agent, by task, the mean squared error of every episode and the mean square of its reference
    [N^2 m^2]; the episodes are the same for all agents.
    """
    names = list(squares)
    tasks = [t for t in squares[names[0]] if all(t in squares[n] for n in names)] if names else []
    if not tasks:
        raise ConfigurationError("The agents to rank must have a task in common.")
    counts = {len(squares[n][t]) for n in names for t in tasks}
    if len(counts) != 1:
        raise ConfigurationError("The agents to rank must have met the same episodes.")
    errors = np.array([[squares[n][t] for t in tasks] for n in names])
    wanted = np.array([[powers[n][t] for t in tasks] for n in names])
    count = counts.pop()
    rng = np.random.default_rng(0)
    drawn = np.empty((RESAMPLES, len(names)))
    for k in range(RESAMPLES):
        rows = rng.integers(count, size=(1, len(tasks), count))
        drawn[k] = _scores(
            np.take_along_axis(errors, rows, axis=2), np.take_along_axis(wanted, rows, axis=2)
        )
    scores = _scores(errors, wanted)
    worse = _significantly_worse(scores, drawn)
    if count < 2:
        worse[:] = False
    order = [int(i) for i in np.argsort(scores, kind="stable")]
    ranks = np.maximum.accumulate(1 + worse.sum(axis=0)[order])
    places = []
    for at, i in enumerate(order):
        low, high = np.exp(np.quantile(drawn[:, i], (0.025, 0.975)))
        ratio: tuple[float | None, float | None, float | None] = (None, None, None)
        clear = None
        if at + 1 < len(order):
            j = order[at + 1]
            ends = np.exp(np.quantile(drawn[:, i] - drawn[:, j], (0.025, 0.975)))
            ratio = (float(np.exp(scores[i] - scores[j])), float(ends[0]), float(ends[1]))
            clear = bool(worse[i, j]) if count > 1 else None  # one episode says nothing of chance
        places.append(
            Place(
                int(ranks[at]),
                names[i],
                float(np.exp(scores[i])),
                float(low),
                float(high),
                *ratio,
                clear,
            )
        )
    return places


def _scores(errors: Floats, wanted: Floats) -> Floats:
    """Return the logarithm of the score of every agent, shape (agents,)."""
    ratio = errors.mean(axis=2) / wanted.mean(axis=2)
    return np.asarray(0.5 * np.mean(np.log(ratio), axis=1))


def _significantly_worse(scores: Floats, drawn: Floats) -> NDArray[np.bool_]:
    """Return whether agent j is significantly worse than agent i, shape (agents, agents)."""
    gap = scores[None, :] - scores[:, None]
    moved = drawn[:, None, :] - drawn[:, :, None]
    error = np.maximum(moved.std(axis=0), TINY)
    largest = np.max(np.abs(moved - gap) / error, axis=(1, 2))
    return np.asarray(gap / error > np.quantile(largest, LEVEL))
