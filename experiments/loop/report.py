"""What came of the experiment: a table, a figure, and what they say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

from cjt_gym.datasheet.blocks import Block
from cjt_gym.datasheet.drawing import INK, canvas
from cjt_gym.disk import write_text
from cjt_gym.training import report
from cjt_gym.training.learning.run_folder import versions
from cjt_gym.training.report.figures import COLOURS, WIDTH
from experiments.loop.experiment import ARMS, Outcome, Plan
from experiments.marks import fill, markdown, read_results

NAMES: Final = {
    "controller": "controller alone",
    "nominal": "nominal",
    "wide": "wide randomisation",
    "identified": "identified",
    "true": "true joint",
}
MATERIAL: Final = 0.05
"""Gap above which there is something to recover [-]."""
RESAMPLES: Final = 4000  # of the bootstrap


def summary_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the figures of the experiment as plain data.

    Shares are medians over the joints with a material gap, with the 95 % interval of a bootstrap
    over these joints.
    """
    gaps = [outcome for outcome in outcomes if outcome.gap > MATERIAL]
    worse = {
        arm: [o.joint for o in outcomes if o.error(arm) > (1.0 + MATERIAL) * o.error("nominal")]
        for arm in ("identified", "wide")
    }
    return {
        "joints": len(outcomes),
        "with_a_gap": len(gaps),
        "recovered": {arm: _median([o.recovered(arm) for o in gaps]) for arm in ARMS[2:4]},
        "error_over_nominal": {
            arm: _median([o.error(arm) / o.error("nominal") for o in outcomes]) for arm in ARMS
        },
        "worse_than_nominal": worse["identified"],
        "wide_worse": len(worse["wide"]),
        "names_right": sum(set(o.hidden) == set(o.found) for o in outcomes),
    }


def _median(values: Sequence[float]) -> dict[str, float] | None:
    if not values:
        return None
    rng = np.random.default_rng(0)
    drawn = rng.choice(np.array(values), (RESAMPLES, len(values)))
    low, high = np.quantile(np.median(drawn, axis=1), (0.025, 0.975))
    return {"median": float(np.median(values)), "low": float(low), "high": float(high)}


def table_of(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return one row per joint: hidden effects, effects found, and the error of every arm."""
    head = ["joint", "hides", "found", *(NAMES[arm] for arm in ARMS), "recovered"]
    lines = [head]
    for o in outcomes:
        share = f"{100.0 * o.recovered('identified'):.0f} %" if o.gap > MATERIAL else "no gap"
        names = [", ".join(n).replace("_", " ") or "-" for n in (o.hidden, o.found)]
        lines.append([o.joint, *names, *(f"{o.error(arm):.3g}" for arm in ARMS), share])
    return lines


def noise_of(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return a line per datasheet: the median amplification of the sensor's noise."""
    lines = [["joints", "structure", *(NAMES[arm] for arm in ARMS)]]
    for group, members in groupby(outcomes, key=lambda o: o.joint[:-1]):
        same = list(members)
        medians = (np.median([o.noise[arm] for o in same]) for arm in ARMS)
        words = same[0].structure.replace("_", " ")
        lines.append([f"{group}*", words, *(f"{value:.1f}" for value in medians)])
    return lines


def verdict(found: dict[str, Any]) -> str:
    """Return in words what came out."""
    share, wide = found["recovered"]["identified"], found["recovered"]["wide"]
    worse = found["worse_than_nominal"]
    text = (
        f"{found['joints']} joints; on {found['with_a_gap']} of them the policy of the nominal "
        f"joint tracks more than {100.0 * MATERIAL:.0f} % worse than that of the true joint. "
    )
    if share is not None:
        text += (
            f"Training on the identified joint recovers {_percent(share)} of this gap in the "
            f"median joint, wide randomisation {_percent(wide)}. "
        )
    medians = ", ".join(
        f"{NAMES[arm]} {_percent(found['error_over_nominal'][arm])}"
        for arm in ("wide", "identified", "true")
    )
    text += (
        f"Error over that of nominal, median of all joints: {medians}. "
        f"Training on the identified joint made {', '.join(worse) or 'none'} worse by more than "
        f"{100.0 * MATERIAL:.0f} %, wide randomisation {found['wide_worse']} of all. "
        f"The diagnosis named all that was hidden, and nothing else, on {found['names_right']}. "
        "In brackets: 95 % intervals of a bootstrap over the joints."
    )
    return text


def _percent(share: dict[str, float]) -> str:
    median, low, high = (100.0 * share[key] for key in ("median", "low", "high"))
    return f"{median:.0f} % ({low:.0f} .. {high:.0f})"


def figure_of(outcomes: Sequence[Outcome]) -> str:
    """Return every joint's errors, relative to the policy of its true joint, as SVG."""
    order = sorted(outcomes, key=lambda o: o.gap)
    rows = np.arange(len(order))
    ratios = {arm: [o.error(arm) / o.error("true") for o in order] for arm in ARMS[:4]}
    with canvas(WIDTH, 1.4 + 0.22 * len(order)) as (figure, written):
        axes = figure.subplots()
        axes.hlines(rows, ratios["nominal"], ratios["identified"], colors=COLOURS[3], linewidth=0.8)
        for arm, colour in zip(ratios, COLOURS, strict=False):
            axes.plot(ratios[arm], rows, "o", color=colour, markersize=4, label=NAMES[arm])
        axes.axvline(1.0, color=INK, linewidth=0.8)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_yticks(rows, [_label(o) for o in order])
        axes.set_xlabel("error over that of the policy of the true joint")
        axes.grid(axis="y", visible=False)
        figure.legend(loc="outside upper right", ncols=4)
        return written()


def _label(outcome: Outcome) -> str:
    names = ", ".join(outcome.hidden).replace("_", " ")
    return f"{names}  {outcome.joint.removeprefix('joint_')}"


def write_results(outcomes: Sequence[Outcome], plan: Plan, seconds: float) -> None:
    """Write `loop.json`."""
    data = {
        "plan": {**vars(plan), "out": None},
        "summary": summary_of(outcomes),
        "joints": [vars(o) for o in outcomes],
        "versions": versions(),
        "seconds": seconds,
    }
    write_text(plan.out / "loop.json", json.dumps(data, indent=1) + "\n")


def read_outcomes(folder: Path) -> dict[str, Any]:
    """Return what `loop.json` of a folder holds; its "joints" are of `Outcome`."""
    data, names = read_results(folder, "loop"), ("hidden", "found")
    joints = [{**row, **{name: tuple(row[name]) for name in names}} for row in data["joints"]]
    return {**data, "joints": [Outcome(**row) for row in joints]}


def write_document(path: Path, data: dict[str, Any]) -> Path:
    """Write facts, summary and table between the marks of a Markdown document; return its path.

    A mark is `<!-- loop: NAME -->`, its end `<!-- end of loop: NAME -->`. The figure goes to
    `figures/loop.svg` beside the document.

    Raises:
        MissingFileError: There is no such document.
        ConfigurationError: It has no mark, or one without an end.
    """
    outcomes = data["joints"]
    parts = {
        "facts": facts(data),
        "summary": verdict(summary_of(outcomes)),
        "joints": markdown(table_of(outcomes)),
        "noise": markdown(noise_of(outcomes)),
    }
    fill(path, "loop", parts)
    (path.parent / "figures").mkdir(exist_ok=True)
    write_text(path.parent / "figures" / "loop.svg", figure_of(outcomes))
    return path


def facts(data: dict[str, Any]) -> str:
    """Return in a sentence what was run."""
    plan, outcomes = data["plan"], data["joints"]
    steps, more = (f"{plan[name]:,}".replace(",", " ") for name in ("steps", "more"))
    named = ", ".join(f"{name} {version}" for name, version in data["versions"].items())
    return (
        f"{len(outcomes)} joints with {plan['groups']} datasheets, seed {plan['seed']}, one "
        f"training of each policy; {steps} steps on the datasheet, {more} more of "
        f"each that continues. Versions: {named}."
    )


def write_page(folder: Path, outcomes: Sequence[Outcome]) -> Path:
    """Write `report.html` and return its path."""
    found = summary_of(outcomes)
    parts: list[Block] = [
        report.paragraph(verdict(found)),
        report.figure(
            figure_of(outcomes),
            "Error of the true torque over the reference, geometric mean over steps, chirp, "
            "multisine and smooth levels, relative to the policy that went on learning on the true "
            "joint. Joints by the gap of the nominal policy; a line leads from it to that of the "
            "identified joint.",
        ),
        report.paragraph(
            "Error of the true torque over the reference, geometric mean over the tasks [-]:",
            note=True,
        ),
        report.html_table(table_of(outcomes)),
        report.paragraph(
            "Amplification of the torque sensor's noise by the command at rest [-]:", note=True
        ),
        report.html_table(noise_of(outcomes)),
        report.paragraph(
            "Every joint belongs to a simulator that shares no code with the one that policies "
            "learn in. One policy learns on the joint of the datasheet; from it go on, for as many "
            "steps each, nominal on that joint, identified on the joint that the diagnosis of two "
            "records gave, and true joint on the one that it is. wide randomisation: learnt on "
            "joints with widely drawn effects, for as many steps in all. controller alone: PD "
            "with feed-forward, designed on the datasheet, the base of the policies. recovered: "
            "the share of the difference between nominal and true joint.",
            note=True,
        ),
    ]
    return report.write_page(folder / "report.html", "Closing the loop", parts)
