"""Tables and sentences of a comparison, from its plain data."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from experiments.results.plan import HELD_OUT

Found = Mapping[str, Any]
Cells = list[list[str]]
SHOWN: Final = 8
"""Controllers of a table that does not need all, the best first."""
LABELS: Final = {
    "output_fixed_rigid_gearbox": "Output fixed, rigid gear",
    "rigid_gearbox": "Output free, rigid gear",
}


def label(found: Found) -> str:
    """Return the name of a structure in words."""
    return LABELS.get(found["structure"], str(found["structure"]).replace("_", " "))


def sentence(found: Found) -> str:
    """Return in words which agent is better on a structure, and at what cost."""
    best, noise = found["best"], [found["noise"][name] for name in ("policy", found["best"])]
    price = ""
    if None not in noise:
        price = (
            f" At rest the noise of their command is {noise[0]:.1f} times that of the torque "
            f"sensor; with {best} it is {noise[1]:.1f} times."
        )
    chance = "" if is_clear(found["ratio"]) else ", which could be chance"
    return (
        f"{label(found)}: the policies have {within(found['ratio'])} of the error of {best}, the "
        f"best controller{chance}.{price}"
    )


def within(ratio: Mapping[str, float]) -> str:
    """Return a figure with its interval."""
    return f"{ratio['value']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})"


def is_clear(ratio: Mapping[str, float]) -> bool:
    """Whether the interval of a ratio leaves out 1."""
    return ratio["high"] < 1.0 or ratio["low"] > 1.0


def ranked(found: Found) -> list[str]:
    """Return policies and controllers, the best first."""
    return sorted(found["score"], key=lambda name: float(found["score"][name]))


def shown(found: Found) -> list[str]:
    """Return the policies, the best controllers and the policies' base, the best first."""
    order = [name for name in ranked(found) if name != "policy"]
    kept = {"policy", found["base"], *order[:SHOWN]}
    return [name for name in ranked(found) if name in kept]


def scores(found: Found) -> Cells:
    """Return error, noise, command and probability of improvement of every agent."""
    rows = [
        [
            "agent",
            "score",
            "noise",
            "change [N m]",
            "above 100 Hz [N m]",
            "effort [N m]",
            "P better",
        ]
    ]
    for name in ranked(found):
        noise, command = found["noise"][name], found["commands"][name]
        better = found["improvement"].get(name)
        rows.append(
            [
                name,
                f"{found['score'][name]:.3f}",
                "-" if noise is None else f"{noise:.2f}",
                f"{command['change']:.2f}",
                f"{command['fast']:.2f}",
                f"{command['effort']:.1f}",
                "-" if better is None else within(better),
            ]
        )
    return rows


def tasks(found: Found) -> Cells:
    """Return the nrmse of the policies, of the best controller and of the best one, by task."""
    best, rows = found["best"], [["task", "policies", found["best"], "best on the task"]]
    for task in found["tasks"]["policy"]:
        name = best_on(found, task)
        rows.append(
            [
                f"{task} (held out)" if task in HELD_OUT else task,
                *(f"{found['tasks'][who][task]:.3f}" for who in ("policy", best)),
                f"{name} {found['tasks'][name][task]:.3f}",
            ]
        )
    return rows


def best_on(found: Found, task: str) -> str:
    """Return the controller with the least error on a task."""
    names: list[str] = [name for name in found["tasks"] if name != "policy"]
    return min(names, key=lambda name: float(found["tasks"][name][task]))


def joints(found: Found) -> Cells:
    """Return the scores on other joints, over the policies' base and over the best controller."""
    rows = [["joint", "policies", "base", "policies / base", "best", "policies / best"]]
    for row in found["joints"]:
        over, base = row.get("over_base"), row["score"].get(found["base"])
        rows.append(
            [
                row["case"],
                number(row["score"].get("policy")),
                number(base),
                "-" if over is None else within(over),
                f"{row['best']} {row['score'][row['best']]:.3f}" if "best" in row else "-",
                within(row["ratio"]) if "ratio" in row else "-",
            ]
        )
    return rows


def shifts(found: Found) -> Cells:
    """Return the scores in a wider box and under more delay."""
    rows = [["conditions", "policies", "best of the controllers", "policies / best"]]
    for row in found["shifts"]:
        rows.append(
            [
                row["case"],
                number(row["score"].get("policy")),
                f"{row['best']} {row['score'][row['best']]:.3f}" if "best" in row else "-",
                within(row["ratio"]) if "ratio" in row else "-",
            ]
        )
    return rows


def worst(found: Found) -> Cells:
    """Return the errors at the centre of the box and at its worst point."""
    rows = [["agent", "centre", "worst", "worst / centre", "where"]]
    agents = found["worst"]["agents"]
    for name in sorted(agents, key=lambda name: float(agents[name]["worst"])):
        row = agents[name]
        place = ", ".join(f"{key} {value:.3g}" for key, value in row["where"].items())
        figures = [row["middle"], row["worst"], row["worst"] / row["middle"]]
        rows.append([name, *(f"{x:.3f}" for x in figures), place])
    return rows


def port(found: Found, everybody: bool = False) -> Cells:
    """Return the damping felt at the output, by frequency."""
    agents = found["port"]["agents"]
    names = [n for n in (ranked(found) if everybody else shown(found)) if n in agents]
    frequencies = list(next(iter(agents.values()))["resistance"]) if agents else []
    rows = [["agent", *(f"{f} Hz" for f in frequencies)]]
    for name in names:
        lines = {name: agents[name]["resistance"]}
        if "least" in agents[name]:
            lines[f"{name}, the least of all trainings"] = agents[name]["least"]
        rows += [[who, *(f"{row[f]:.3f}" for f in frequencies)] for who, row in lines.items()]
    return rows


def wins(found: Found) -> Cells:
    """Return where a classical controller is better than the policies."""
    rows = [["where", "controller", "its figure", "policies"]]
    return rows + [[where, who, f"{x:.3f}", f"{y:.3f}"] for where, who, x, y in _wins(found)]


def _wins(found: Found) -> Iterator[tuple[str, str, float, float]]:
    best = found["best"]
    if found["score"][best] < found["score"]["policy"]:
        yield "score", best, found["score"][best], found["score"]["policy"]
    for task, mine in found["tasks"]["policy"].items():
        name = best_on(found, task)
        if found["tasks"][name][task] < mine:
            yield f"task {task}", name, found["tasks"][name][task], mine
    noise = [found["noise"][name] for name in (best, "policy")]
    if None not in noise and noise[0] < noise[1]:
        yield "noise amplification", best, noise[0], noise[1]
    words = {"change": "change of the command [N m]", "fast": "command above 100 Hz [N m]"}
    for key, what in words.items():
        pair = [found["commands"][name][key] for name in (best, "policy")]
        if pair[0] < pair[1]:
            yield what, best, pair[0], pair[1]
    for row in (*found["shifts"][1:], *found["joints"]):
        if "best" in row and row["score"][row["best"]] < row["score"]["policy"]:
            name = row["best"]
            yield f"score, {row['case']}", name, row["score"][name], row["score"]["policy"]
    yield from _wins_of_others(found)


def _wins_of_others(found: Found) -> Iterator[tuple[str, str, float, float]]:
    agents = found["worst"]["agents"]
    rivals = [name for name in agents if name != "policy"]
    if rivals and "policy" in agents:
        name = min(rivals, key=lambda name: float(agents[name]["worst"]))
        if agents[name]["worst"] < agents["policy"]["worst"]:
            yield "worst point of the box", name, agents[name]["worst"], agents["policy"]["worst"]
    agents, best = found["port"]["agents"], found["best"]
    if "policy" in agents and best in agents:
        for f, mine in agents["policy"]["least"].items():
            theirs = agents[best]["resistance"][f]
            if mine < 0.0 <= theirs:
                yield f"damping of the output at {f} Hz", best, theirs, mine


def number(value: float | None) -> str:
    """Return a figure, or a dash."""
    return "-" if value is None else f"{value:.3f}"


def verdicts(found: Found) -> list[str]:
    """Return in words what the parts beside the score show."""
    rows = [row for row in found["joints"] if "ratio" in row]
    over = [row for row in rows if "over_base" in row]
    agents = found["worst"]["agents"]
    texts = []
    if rows:
        texts.append(
            f"On {len(rows)} joints not used for training, the policies beat the best "
            f"controller on {_better(rows, 'ratio')}"
            + (f" and their base on {_better(over, 'over_base')}." if over else ".")
        )
    if "policy" in agents:
        most = agents["policy"]
        texts.append(
            f"At the worst point of the parameter box their error is "
            f"{most['worst'] / most['middle']:.2f} times that at its centre; the largest of any "
            f"training is {most['most']:.3f}."
        )
    if "policy" in found["port"]["agents"]:
        least = found["port"]["agents"]["policy"]["least"]
        active = [f for f, value in least.items() if value < 0.0]
        texts.append(
            f"In at least one training the joint feeds energy into its load at "
            f"{', '.join(active)} Hz."
            if active
            else "No training feeds energy into the load at any of the frequencies."
        )
    return texts


def _better(rows: Sequence[Found], key: str) -> str:
    better = [row for row in rows if row[key]["value"] < 1.0]
    clear = [row for row in better if is_clear(row[key])]
    return f"{len(better)} ({len(clear)} clearly)"


PARTS: Final[dict[str, Callable[[Found], Cells]]] = {
    "scores": scores,
    "tasks": tasks,
    "joints": joints,
    "shifts": shifts,
    "worst": worst,
    "port": port,
    "wins": wins,
}
"""Every table by its name, which is also that of its place in a Markdown page."""
