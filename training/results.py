"""Learned against classical, for anyone to repeat: `python -m cjt_gym.training.results`.

For each structure a policy is trained from several seeds by one recipe, and meets every classical
controller on episodes, parameter draws and tasks that no training saw. Training seeds are what
differs between trainings, so they are what intervals are drawn over, beside the episodes
(Agarwal et al., 2021, Deep Reinforcement Learning at the Edge of the Statistical Precipice).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from cjt_gym.baselines import CONTROLLERS
from cjt_gym.errors import CjtGymError
from cjt_gym.training import report
from cjt_gym.training.benchmark import align
from cjt_gym.training.benchmark_results import write_benchmark
from cjt_gym.training.config import load_config
from cjt_gym.training.figures import COLOURS, new_figure, to_svg
from cjt_gym.training.grid import make_cells, run_grid
from cjt_gym.training.run_folder import versions
from cjt_gym.training.train import train

Floats = NDArray[np.float64]
Say = Callable[[str], None]
STRUCTURES: Final = ("output_fixed_rigid_gearbox", "rigid_gearbox")
TRAINED: Final = ("step", "chirp", "multisine", "smooth")
"""Kinds of references that the trainings draw from."""
HELD_OUT: Final = ("reversal", "load_motion")
"""Tasks that no training saw."""
RESAMPLES: Final = 2000
SHOWN: Final = 8
"""Controllers in a table, the best first."""


@dataclass(frozen=True)
class Plan:
    """How large a comparison is.

    Attributes:
        out: Folder for everything; what is there is not done again.
        joint: The joint.
        recipe: Configuration of the training.
        seeds: Trainings of each structure.
        steps: Of a training; None for those of the recipe.
        episodes: Of each task.
        jobs: Processes.
    """

    out: Path
    joint: str = "orange_80_6000"
    recipe: str = "quiet_residual"
    seeds: int = 5
    steps: int | None = None
    episodes: int = 32
    jobs: int = 2


def run_results(plan: Plan, say: Say = lambda text: None) -> list[dict[str, Any]]:
    """Train, compare, write `results.json` and `report.html`; return the summary of each structure.

    Raises:
        CjtGymError: The recipe, the joint or a run cannot be used.
    """
    work = Parallel(n_jobs=plan.jobs, return_as="generator_unordered")
    tasks = [delayed(_train)(plan, s, seed) for s in STRUCTURES for seed in range(plan.seeds)]
    for name in work(tasks):
        say(f"trained {name}")
    found = []
    for structure in STRUCTURES:
        runs = [str(_run(plan, structure, seed)) for seed in range(plan.seeds)]
        names = (*TRAINED, *HELD_OUT)
        laws = [name for name, row in CONTROLLERS.items() if not row.renders]
        cells = make_cells(laws, runs, [plan.joint], [structure], names, [0], plan.episodes)
        folder = plan.out / structure
        told = run_grid(cells, folder / "cells", plan.jobs, "loky", lambda result: None)
        write_benchmark(told, folder, [f"{plan.joint}, {plan.episodes} episodes of every task."])
        found.append(summary_of(structure, [r for r in told if r["status"] == "done"]))
        say(sentence(found[-1]))
    _write(plan, found)
    return found


def _run(plan: Plan, structure: str, seed: int) -> Path:
    return plan.out / "runs" / f"{structure}_{seed}"


def _train(plan: Plan, structure: str, seed: int) -> str:
    config = load_config(plan.recipe)
    env = {**config.env, "joint": plan.joint, "structure": structure}
    changed = config.with_changes(env=env, seed=1000 * seed, total_steps=plan.steps)
    return train(changed, _run(plan, structure, seed), quiet=True).path.name


def summary_of(structure: str, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what policies and controllers came to on a structure, as plain data.

    The score of an agent is its nrmse, geometric mean over the tasks; that of the policies is the
    interquartile mean over the trainings.

    Args:
        structure: Its name.
        results: Finished cells of the benchmark.
    """
    learned = [r for r in results if r["kind"] != "classical"]
    classical = [r for r in results if r["kind"] == "classical"]
    scores = {r["agent"]: _score(r) for r in results}
    best = min(classical, key=lambda r: scores[r["agent"]])
    ratios = _ratios(learned, best)
    return {
        "structure": structure,
        "score": {
            "policy": _iqm(np.array([scores[r["agent"]] for r in learned])),
            **{r["agent"]: scores[r["agent"]] for r in classical},
        },
        "noise": {
            "policy": _mean_noise(learned),
            **{r["agent"]: _mean_noise([r]) for r in classical},
        },
        "tasks": {
            "policy": {t: _iqm(np.array([_nrmse(r, t) for r in learned])) for t in best["squares"]},
            best["agent"]: {t: _nrmse(best, t) for t in best["squares"]},
        },
        "best": best["agent"],
        "ratio": ratios,
        "seeds": [scores[r["agent"]] for r in learned],
    }


def _nrmse(result: Mapping[str, Any], task: str) -> float:
    squares, powers = (np.mean(result[kind][task]) for kind in ("squares", "powers"))
    return float(np.sqrt(squares / powers))


def _score(result: Mapping[str, Any]) -> float:
    return float(np.exp(np.mean([np.log(_nrmse(result, t)) for t in result["squares"]])))


def _mean_noise(results: Sequence[Mapping[str, Any]]) -> float | None:
    values = [r["rows"][0]["noise_amplification"] for r in results]
    return None if None in values else float(np.mean(values))


def _iqm(values: Floats) -> float:
    """Return the mean of the middle half, whole values weighted by how much of them is in it."""
    ordered = np.sort(values)
    count = len(ordered)
    edges = np.arange(count + 1) / count
    inside = np.clip(np.minimum(edges[1:], 0.75) - np.maximum(edges[:-1], 0.25), 0.0, None)
    return float(np.sum(ordered * inside) / np.sum(inside))


def _ratios(learned: Sequence[Mapping[str, Any]], best: Mapping[str, Any]) -> dict[str, float]:
    """Return the policies' score over that of the best controller, with its 95 % interval.

    Trainings are drawn anew with replacement, and so are the episodes of every task, the same for
    policies and controller.
    """
    rng, tasks = np.random.default_rng(0), list(best["squares"])
    mine = np.array([[r["squares"][t] for t in tasks] for r in learned])
    theirs = np.array([best["squares"][t] for t in tasks])
    count, drawn = theirs.shape[1], np.empty(RESAMPLES)

    def ratio(seeds: NDArray[np.int64], rows: NDArray[np.int64]) -> float:
        one = np.take_along_axis(mine[seeds], rows[None], axis=2).mean(axis=2)
        other = np.take_along_axis(theirs, rows, axis=1).mean(axis=1)
        scores = np.exp(0.5 * np.mean(np.log(one / other), axis=1))
        return _iqm(scores)

    every = np.arange(len(mine)), np.tile(np.arange(count), (len(tasks), 1))
    for k in range(RESAMPLES):
        seeds = rng.integers(len(mine), size=len(mine))
        drawn[k] = ratio(seeds, rng.integers(count, size=(len(tasks), count)))
    low, high = np.quantile(drawn, (0.025, 0.975))
    return {"value": ratio(*every), "low": float(low), "high": float(high)}


def sentence(found: Mapping[str, Any]) -> str:
    """Return in words who is better on a structure, and at what price."""
    ratio, best = found["ratio"], found["best"]
    clear = ratio["high"] < 1.0 or ratio["low"] > 1.0
    noise = [found["noise"][name] for name in ("policy", best)]
    price = (
        ""
        if None in noise
        else (
            f" At rest its command shakes {noise[0]:.1f} times as much as the torque sensor's "
            f"noise, "
            f"that of {best} {noise[1]:.1f} times."
        )
    )
    return (
        f"{found['structure']}: error of the policies over that of {best}, the best controller: "
        f"{ratio['value']:.2f} ({ratio['low']:.2f} .. {ratio['high']:.2f})"
        f"{'' if clear else ', which could be chance'}.{price}"
    )


def table_of(found: Mapping[str, Any]) -> list[list[str]]:
    """Return the policies and the best controllers of a structure, the best first."""
    order = sorted(found["score"], key=lambda name: found["score"][name])
    order = [n for n in order if n == "policy" or order.index(n) < SHOWN + 1]
    rows = [["agent", "score", "noise"]]
    for name in order:
        noise = found["noise"][name]
        shown = "-" if noise is None else f"{noise:.2f}"
        rows.append([name, f"{found['score'][name]:.3f}", shown])
    return rows


def tasks_of(found: Mapping[str, Any]) -> list[list[str]]:
    """Return the nrmse of the policies and of the best controller by task."""
    names = list(found["tasks"])
    rows = [["task", *names]]
    for task in found["tasks"]["policy"]:
        label = f"{task} (never trained)" if task in HELD_OUT else task
        rows.append([label, *(f"{found['tasks'][name][task]:.3f}" for name in names)])
    return rows


def _figure(found: Mapping[str, Any]) -> str:
    """Return score against noise of everybody, as SVG."""
    figure = new_figure(3.4)
    axes = figure.subplots()
    for name, score in found["score"].items():
        noise = found["noise"][name]
        if noise is not None and np.isfinite(score):
            mine = name == "policy"
            axes.plot(max(noise, 0.1), score, "o", color=COLOURS[2] if mine else COLOURS[0])
            axes.annotate(
                name.replace("_", " "),
                (max(noise, 0.1), score),
                textcoords="offset points",
                xytext=(4, 3),
                fontsize=7,
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("amplification of the torque sensor's noise")
    axes.set_ylabel("nrmse, geometric mean over tasks")
    return to_svg(figure)


def _write(plan: Plan, found: Sequence[Mapping[str, Any]]) -> None:
    data = {"plan": {**asdict(plan), "out": None}, "structures": found, "versions": versions()}
    plan.out.mkdir(parents=True, exist_ok=True)
    (plan.out / "results.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    parts = []
    for one in found:
        parts += [
            report.heading(str(one["structure"]).replace("_", " ")),
            report.paragraph(sentence(one)),
            report.html_table(table_of(one)),
            report.html_table(tasks_of(one)),
            report.figure(_figure(one), "Everybody's error and what it costs in noise."),
        ]
    report.write_page(plan.out / "report.html", "Learned against classical", parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison and print its tables."""
    parser = argparse.ArgumentParser(description="Compare learned with classical controllers.")
    add, usual = parser.add_argument, Plan(Path("results"))
    add("--out", type=Path, default=usual.out)
    add("--joint", default=usual.joint)
    add("--recipe", default=usual.recipe, help="configuration of the training")
    add("--seeds", type=int, default=usual.seeds, help="trainings of each structure")
    add("--steps", type=int, help="of a training, instead of the recipe's")
    add("--episodes", type=int, default=usual.episodes, help="of each task")
    add("--jobs", type=int, default=usual.jobs, help="processes")
    plan, begun = Plan(**vars(parser.parse_args(arguments))), time.monotonic()
    try:
        found = run_results(plan, _say)
    except CjtGymError as error:
        sys.stderr.write(f"results: {error}\n")
        return 2
    for one in found:
        tables = f"{align(table_of(one))}\n\n{align(tasks_of(one))}"
        sys.stdout.write(f"{sentence(one)}\n\n{tables}\n\n")
    sys.stdout.write(f"{plan.out / 'report.html'}: {time.monotonic() - begun:.0f} s\n")
    return 0


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")


if __name__ == "__main__":
    sys.exit(main())
