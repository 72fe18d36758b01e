"""What came of the experiment: a table, a figure, and what they say."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cjt_gym.training import report
from cjt_gym.training.figures import COLOURS, INK, new_figure, to_svg
from cjt_gym.training.loop.experiment import ARMS, Outcome, Plan
from cjt_gym.training.run_folder import versions

NAMES: Final = {
    "controller": "controller alone",
    "nominal": "nominal",
    "wide": "wide randomisation",
    "identified": "identified",
    "true": "true joint",
}
MATERIAL: Final = 0.05
"""Gap above which there is something to recover [-]."""
RESAMPLES: Final = 4000


def summary_of(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the figures of the experiment as plain data.

    Shares are medians over the joints with a material gap, with the 95 % interval of a bootstrap
    over these joints.
    """
    gaps = [outcome for outcome in outcomes if outcome.gap > MATERIAL]
    worse = [
        o.joint for o in outcomes if o.rmse("identified") > (1.0 + MATERIAL) * o.rmse("nominal")
    ]
    return {
        "joints": len(outcomes),
        "with_a_gap": len(gaps),
        "recovered": {arm: _median([o.recovered(arm) for o in gaps]) for arm in ARMS[2:4]},
        "error_over_nominal": {
            arm: _median([o.rmse(arm) / o.rmse("nominal") for o in outcomes]) for arm in ARMS
        },
        "worse_than_nominal": worse,
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
    """Return a line per joint: what it hides, what was found, and everybody's error."""
    head = ["joint", "hides", "found", *(f"{NAMES[arm]} [N m]" for arm in ARMS), "recovered"]
    lines = [head]
    for o in outcomes:
        share = f"{100.0 * o.recovered('identified'):.0f} %" if o.gap > MATERIAL else "no gap"
        names = [", ".join(n).replace("_", " ") or "-" for n in (o.hidden, o.found)]
        lines.append([o.joint, *names, *(f"{o.rmse(arm):.3g}" for arm in ARMS), share])
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
    text += (
        f"It made {', '.join(worse) or 'none'} worse by more than {100.0 * MATERIAL:.0f} %. "
        f"The diagnosis named all that was hidden, and nothing else, on {found['names_right']}."
    )
    return text


def _percent(share: dict[str, float]) -> str:
    median, low, high = (100.0 * share[key] for key in ("median", "low", "high"))
    return f"{median:.0f} % ({low:.0f} .. {high:.0f})"


def figure_of(outcomes: Sequence[Outcome]) -> str:
    """Return every joint's errors, relative to the policy of its true joint, as SVG."""
    order = sorted(outcomes, key=lambda o: o.gap)
    figure = new_figure(0.6 + 0.24 * len(order))
    axes = figure.subplots()
    rows = np.arange(len(order))
    for arm, colour in zip(ARMS[:4], COLOURS, strict=False):
        ratios = [o.rmse(arm) / o.rmse("true") for o in order]
        axes.plot(ratios, rows, "o", color=colour, markersize=5, label=NAMES[arm])
    for row, o in zip(rows, order, strict=True):
        ends = [o.rmse(arm) / o.rmse("true") for arm in ("nominal", "identified")]
        axes.plot(ends, [row, row], color=COLOURS[3], linewidth=0.8, zorder=0)
    axes.axvline(1.0, color=INK, linewidth=0.8)
    axes.set_xscale("log")
    axes.set_yticks(rows, [", ".join(o.hidden).replace("_", " ") for o in order])
    axes.set_xlabel("error over that of the policy of the true joint")
    axes.grid(axis="y", visible=False)
    axes.legend(loc="lower right")
    return to_svg(figure)


def write_report(outcomes: Sequence[Outcome], plan: Plan, seconds: float) -> Path:
    """Write `loop.json` and `report.html`; return the latter."""
    found = summary_of(outcomes)
    data = {
        "plan": {**vars(plan), "out": None},
        "summary": found,
        "joints": [vars(o) for o in outcomes],
        "versions": versions(),
        "seconds": seconds,
    }
    (plan.out / "loop.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    parts = [
        report.paragraph(verdict(found)),
        report.figure(
            figure_of(outcomes),
            "Root mean square error of the true torque over steps, chirp, multisine and smooth "
            "levels, relative to the policy that went on learning on the true joint. Joints by the "
            "gap of the nominal policy; a line leads from it to that of the identified joint.",
        ),
        report.html_table(table_of(outcomes)),
        report.paragraph(
            "Every joint belongs to a simulator that shares no code with the one that policies "
            "learn in. nominal: learnt on the joint of the datasheet. wide randomisation: learnt "
            "on widely drawn joints. identified and true joint: went on from nominal, for as many "
            "steps each, on the joint that the diagnosis of two records gave and on the one that "
            "it is. controller alone: PD with feed-forward, designed on the datasheet, the base of "
            "the policies. recovered: the share of the difference between nominal and true joint.",
            note=True,
        ),
    ]
    return report.write_page(plan.out / "report.html", "Closing the loop", parts)
