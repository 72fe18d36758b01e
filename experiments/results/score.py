"""What policies and controllers came to, with intervals over trainings and episodes.

Training seeds are what differs between trainings, so they are what intervals are drawn over, beside
the episodes (Agarwal et al., 2021, Deep Reinforcement Learning at the Edge of the Statistical
Precipice).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Result = Mapping[str, Any]
RESAMPLES: Final = 2000  # of the bootstrap
ENDS: Final = (0.025, 0.975)  # of a 95 % interval
THRESHOLDS: Final = tuple(float(x) for x in np.geomspace(0.02, 2.0, 41))
"""Errors of an episode over its reference, of the performance profiles."""
COMMANDS: Final = ("change", "fast", "effort")


def summary_of(structure: str, results: Sequence[Result]) -> dict[str, Any]:
    """Return what policies and controllers came to on a structure, as plain data.

    The score of an agent is its nrmse, geometric mean over the tasks; that of the policies is the
    interquartile mean over the trainings.

    Args:
        structure: Its name.
        results: Finished cells of the benchmark.
    """
    learned, classical = split(results)
    scores = {r["agent"]: score(r) for r in results}
    order = sorted(classical, key=lambda r: scores[r["agent"]])
    best = order[0]
    groups = {"policy": learned, **{r["agent"]: [r] for r in order}}
    return {
        "structure": structure,
        "score": {name: policies_score(group) for name, group in groups.items()},
        "noise": {name: _mean_noise(group) for name, group in groups.items()},
        "commands": {name: _commands(group) for name, group in groups.items()},
        "tasks": {
            name: {t: iqm(np.array([nrmse(r, t) for r in group])) for t in best["squares"]}
            for name, group in groups.items()
        },
        "profile": {name: profile(group) for name, group in groups.items()},
        "improvement": {r["agent"]: improvement(learned, r) for r in order},
        "best": best["agent"],
        "ratio": ratio(learned, best),
    }


def split(results: Sequence[Result]) -> tuple[list[Result], list[Result]]:
    """Return the policies' results and those of the controllers."""
    learned = [r for r in results if r["kind"] != "classical"]
    return learned, [r for r in results if r["kind"] == "classical"]


def nrmse(result: Result, task: str) -> float:
    """Return the error of a task over its reference [-]."""
    squares, powers = (np.mean(result[kind][task]) for kind in ("squares", "powers"))
    return float(np.sqrt(squares / powers))


def score(result: Result) -> float:
    """Return the nrmse of an agent, geometric mean over the tasks [-]."""
    return float(np.exp(np.mean([np.log(nrmse(result, t)) for t in result["squares"]])))


def policies_score(results: Sequence[Result]) -> float:
    """Return the interquartile mean of the scores [-]."""
    return iqm(np.array([score(r) for r in results]))


def _mean_noise(results: Sequence[Result]) -> float | None:
    values = [r["rows"][0]["noise_amplification"] for r in results]
    return None if None in values else float(np.mean(values))


def _commands(results: Sequence[Result]) -> dict[str, float]:
    """Return the rms over trainings and tasks of the command and its unsteadiness [N m]."""
    every = [task for r in results for task in r["commands"].values()]
    return {
        name: float(np.sqrt(np.mean(np.square([task[name] for task in every]))))
        for name in COMMANDS
    }


def iqm(values: Floats) -> float:
    """Return the mean of the middle half, whole values weighted by how much of them is in it."""
    ordered = np.sort(values)
    count = len(ordered)
    edges = np.arange(count + 1) / count
    inside = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    return float(np.sum(ordered * inside) / np.sum(inside))


def ratio(learned: Sequence[Result], other: Result) -> dict[str, float]:
    """Return the policies' score over that of another agent, with its 95 % interval.

    Trainings are drawn anew with replacement, and so are the episodes of every task, the same for
    both.
    """
    mine, theirs = squares_of(learned, other), squares_of([other], other)[0]
    rng, (trainings, tasks, episodes) = np.random.default_rng(0), mine.shape

    def figure(seeds: NDArray[np.int64], rows: NDArray[np.int64]) -> float:
        one = np.take_along_axis(mine[seeds], rows[None], axis=2).mean(axis=2)
        base = np.take_along_axis(theirs, rows, axis=1).mean(axis=1)
        return iqm(np.exp(0.5 * np.mean(np.log(one / base), axis=1)))

    value = figure(np.arange(trainings), np.tile(np.arange(episodes), (tasks, 1)))
    drawn = [
        figure(
            rng.integers(trainings, size=(trainings,)),
            rng.integers(episodes, size=(tasks, episodes)),
        )
        for _ in range(RESAMPLES)
    ]
    low, high = np.quantile(drawn, ENDS)
    return {"value": value, "low": float(low), "high": float(high)}


def improvement(learned: Sequence[Result], other: Result) -> dict[str, float]:
    """Return the probability that a policy has the smaller error, with its 95 % interval.

    It is the share of pairs of a training and an episode, mean over the tasks; both meet the same
    episode. Ties count half.
    """
    mine, theirs = squares_of(learned, other), squares_of([other], other)
    wins = (mine < theirs) + 0.5 * (mine == theirs)
    return {name: x[0] for name, x in mean_with_interval(wins[..., None]).items()}


def profile(results: Sequence[Result]) -> dict[str, list[float]]:
    """Return the share of episodes whose nrmse is below each of `THRESHOLDS`, with its interval.

    Mean over tasks and trainings.
    """
    errors = np.sqrt(squares_of(results, results[0]) / _array(results[0], "powers"))
    return mean_with_interval(errors[..., None] < np.array(THRESHOLDS))


def mean_with_interval(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return means over trainings, tasks and episodes, and their 95 % intervals.

    Trainings and the episodes of every task are drawn anew with replacement.

    Args:
        values: Shape (trainings, tasks, episodes, figures).

    Returns:
        "value", "low" and "high", each of length figures.
    """
    trainings, tasks, episodes = values.shape[:3]
    rng, flat = np.random.default_rng(0), values.reshape(trainings, tasks * episodes, -1) * 1.0
    seeds = rng.multinomial(trainings, np.full(trainings, 1.0 / trainings), RESAMPLES)
    rows = rng.multinomial(episodes, np.full(episodes, 1.0 / episodes), (RESAMPLES, tasks))
    shares = rows.reshape(RESAMPLES, -1) / (tasks * episodes)
    drawn = sum(seeds[:, i, None] / trainings * (shares @ flat[i]) for i in range(trainings))
    low, high = np.clip(np.quantile(drawn, ENDS, axis=0), flat.min(), flat.max())
    return {"value": flat.mean((0, 1)).tolist(), "low": low.tolist(), "high": high.tolist()}


def squares_of(results: Sequence[Result], like: Result) -> Floats:
    """Return squared errors, shape (results, tasks, episodes), in the order of one's tasks."""
    return np.array([_array(r, "squares", list(like["squares"])) for r in results])


def _array(result: Result, kind: str, tasks: Sequence[str] | None = None) -> Floats:
    return np.array([result[kind][t] for t in (tasks or result[kind])])
