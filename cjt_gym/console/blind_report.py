"""The score of a blind test as one self-contained page, and its cases as a table."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cjt_gym.blind.score import agrees
from cjt_gym.blind.table import defect_rows, lines
from cjt_gym.datasheet.blocks import Block
from cjt_gym.datasheet.drawing import BLUE, GREY, ORANGE, WHOLE, canvas
from cjt_gym.training import report

COLUMNS = (
    "case",
    "kind",
    "structure",
    "excitation",
    "closed_loop",
    "truth",
    "outside",
    "invisible",
    "defects",
    "not_counted",
    "named",
    "status",
    "verdict",
    "first_right",
    "exact",
    "f1",
    "wrong_confirmed",
    "recognised",
    "shrink_predicted",
    "shrink_true",
    "numbers",
    "numbers_covered",
    "seconds",
    "error",
)


def write_csv(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Write one row per case; lists are joined by '+'."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(_flat(row) for row in rows)
    return path


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    shrink = row["shrink"] or {"predicted": None, "true": None}
    flat = {name: row.get(name) for name in COLUMNS} | {
        "shrink_predicted": shrink["predicted"],
        "shrink_true": shrink["true"],
        "numbers": len(row["numbers"]),
        "numbers_covered": sum(number["covered"] for number in row["numbers"]),
    }
    return {k: "+".join(map(str, v)) if isinstance(v, list) else v for k, v in flat.items()}


def write_report(result: Mapping[str, Any], path: Path) -> Path:
    """Write the page: table, confusion matrix, reliability, shrink, all cases."""
    summary, rows = result["summary"], result["cases"]
    settings = ", ".join(f"{k} {v}" for k, v in result["settings"].items() if v is not None)
    scores = [[name.replace("  ", "· "), value] for name, value in lines(summary)]
    parts = [
        report.paragraph(
            f"{summary['cases']} joints with hidden effects ({settings}). Each was simulated by a "
            "simulator of its own and diagnosed by a process that had its records and its "
            "datasheet only. In brackets: 95 % intervals. An effect whose trace in the record is "
            "below five standard deviations of what noise, tolerances and calibration errors do "
            "is invisible, and counts apart."
        ),
        report.html_table([["what was scored", "score"], *scores]),
        *_defects(summary),
        report.heading("True effect and first name"),
        report.figure(
            _confusion(summary["confusion"]),
            "Counts of cases; blue is right, orange wrong. A case with two effects counts for the "
            "one that was named first.",
        ),
        report.heading("Confidence"),
        report.figure(
            _reliability(summary["confidence"]),
            "Names that were right, by how sure the diagnosis was of them; with 95 % intervals "
            "and counts. On the line it keeps its word.",
        ),
        report.heading("Predicted and true shrink of the gap"),
        report.figure(
            _shrink(rows),
            "Share of the replay error on the second record that the found effects take away, "
            "against the share that the true model takes away, in cases where the names were "
            "right.",
        ),
        report.heading("All cases"),
        report.html_table(
            [["case", "", "joint", "true", "named", "verdict", "s"], *map(_case, rows)]
        ),
    ]
    return report.write_page(path, "Blind test of the diagnosis", parts)


def _defects(summary: Mapping[str, Any]) -> list[Block]:
    """Return the section with the score by kind of defect; empty without defects."""
    cells = defect_rows(summary)
    if not cells:
        return []
    return [
        report.heading("Defects of the logs"),
        report.paragraph(
            "A case counts for every defect it has, and one that could not be diagnosed counts "
            "against all. A guessed inertia may be named or not; so may noise that is clearly "
            "more than stated."
        ),
        report.html_table(cells),
    ]


def _case(row: Mapping[str, Any]) -> list[str]:
    good = row["exact"] and row["recognised"] == bool(row["outside"])
    true = [
        f"{name} ({row['signature'].get(name, 0.0):.0f} sigma)"
        for name in (*row["truth"], *(row["outside"]))
    ]
    named = [
        f"{name}{'' if status == 'confirmed' else ' (tentative)'}"
        for name, status in zip(row["named"], row["status"], strict=True)
    ]
    others = [f"{name} (not counted)" for name in row["not_counted"]]
    loop = "closed" if row["closed_loop"] else "open"
    return [
        row["case"],
        "" if good else "wrong",
        ", ".join([f"{row['structure']}, {row['excitation']}, {loop} loop", *row["defects"]]),
        ", ".join(true) or "none",
        ", ".join(named + others) or "none",
        row["error"] or row["verdict"],
        f"{row['seconds'] or 0.0:.1f}",
    ]


def _confusion(confusion: Mapping[str, Any]) -> str:
    """Return the confusion matrix as a picture: right in blue, wrong in orange."""
    names = sorted({*confusion["true"], *confusion["first"]}, key=lambda n: (n[0] == "(", n))
    true = [name for name in names if name in confusion["true"]]
    first = [name for name in names if name in confusion["first"]]
    with canvas(max(WHOLE, 3.0 + 0.3 * len(first)), 2.0 + 0.25 * len(true)) as (figure, written):
        axes = figure.subplots()
        for row, column, count in confusion["counts"]:
            colour = BLUE if agrees(row, column) else ORANGE
            at = first.index(column), true.index(row)
            axes.plot(*at, marker="s", ms=14.0, color=colour)
            axes.text(*at, str(count), ha="center", va="center", color="white")
        axes.set_xlim(-0.5, max(len(first), 1) - 0.5)
        axes.set_ylim(max(len(true), 1) - 0.5, -0.5)
        axes.set_xticks(range(len(first)), first, rotation=90)
        axes.set_yticks(range(len(true)), true)
        axes.set_xlabel("first name")
        axes.set_ylabel("true effect")
        return written()


def _reliability(confidence: Mapping[str, Any]) -> str:
    """Return the reliability diagram: share of right names over confidence."""
    with canvas(WHOLE, 3.2) as (figure, written):
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], "--", color=GREY)
        for k, entry in enumerate(confidence["bins"]):
            x = entry["confidence"]
            axes.plot([x, x], [entry["low"], entry["high"]], color=BLUE)
            axes.plot(x, entry["share"], "o", color=BLUE)
            axes.text(x, 0.04 + 0.06 * (k % 2), f"{entry['hits']}/{entry['total']}", ha="center")
        axes.set(xlim=(0.0, 1.03), ylim=(0.0, 1.03))
        axes.set(xlabel="confidence", ylabel="share of right names")
        return written()


def _shrink(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return predicted over true shrink, with the intervals that were predicted."""
    with canvas(WHOLE, 3.2) as (figure, written):
        axes = figure.subplots()
        axes.plot([0.0, 1.0], [0.0, 1.0], "--", color=GREY)
        for row in rows:
            if s := row["shrink"]:
                low, high = np.clip([s["low"], s["high"]], -0.2, 1.0)
                axes.plot([s["true"], s["true"]], [low, high], color=BLUE, alpha=0.4)
                axes.plot(s["true"], max(s["predicted"], -0.2), "o", color=BLUE, markersize=4)
        axes.set(xlabel="true shrink", ylabel="predicted shrink")
        return written()
