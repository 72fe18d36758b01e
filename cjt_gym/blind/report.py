"""The score of a blind test as one self-contained page, and its cases as a table."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from cjt_gym.blind.score import agrees
from cjt_gym.blind.table import defect_rows, lines

BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#8a8a8a"
STYLE: Final = """
:root { color-scheme: light dark }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
td, th { padding: .2rem .8rem .2rem 0; text-align: left; border-bottom: 1px solid #8884;
  vertical-align: top }
.wide { overflow-x: auto; font-size: 13px } .bad td:first-child { border-left: 4px solid #d55e00;
  padding-left: .4rem } svg { max-width: 100%; height: auto; background: #fff }
td.v { white-space: pre-wrap }
"""
COLUMNS: Final = (
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
    scores = "".join(
        f'<tr><td class="v">{html.escape(name)}</td><td>{html.escape(value)}</td></tr>'
        for name, value in lines(summary)
    )
    body = f"""<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Blind test</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{STYLE}</style></head>
<body><h1>Blind test of the diagnosis</h1>
<p>{summary["cases"]} joints with hidden effects ({html.escape(settings)}). Each was simulated by a
simulator of its own and diagnosed by a process that had its records and its datasheet only. In
brackets: 95 % intervals. An effect whose trace in the record is below five standard deviations of
what noise, tolerances and calibration errors do is invisible, and counts apart.</p>
<table>{scores}</table>
{_defects(summary)}<h2>True effect and first name</h2>
<p>Counts of cases; blue is right, orange wrong. A case with two effects counts for the one that was
named first.</p>
{_svg(confusion_figure(summary["confusion"]))}
<h2>Confidence</h2><p>Names that were right, by how sure the diagnosis was of them; with 95 %
intervals and counts. On the line it keeps its word.</p>
{_svg(reliability_figure(summary["confidence"]))}
<h2>Predicted and true shrink of the gap</h2><p>Share of the replay error on the second record that
the found effects take away, against the share that the true model takes away, in
cases where the names were right.</p>
{_svg(shrink_figure(rows))}
<h2>All cases</h2><div class="wide"><table><tr><th>case</th><th>joint</th><th>true</th>
<th>named</th><th>verdict</th><th>s</th></tr>{"".join(_case(row) for row in rows)}</table></div>
</body></html>
"""
    path.write_text(body, encoding="utf-8")
    return path


def _defects(summary: Mapping[str, Any]) -> str:
    """Return the section with the score by kind of defect; empty without defects."""
    cells = defect_rows(summary)
    if not cells:
        return ""
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in cells
    )
    return f"""<h2>Defects of the logs</h2><p>A case counts for every defect it has, and one that
could not be diagnosed counts against all. A guessed inertia may be named or not; so may noise that
is clearly more than stated.</p>
<div class="wide"><table>{rows}</table></div>
"""


def _case(row: Mapping[str, Any]) -> str:
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
    cells = (
        row["case"],
        ", ".join([f"{row['structure']}, {row['excitation']}, {loop} loop", *row["defects"]]),
        ", ".join(true) or "none",
        ", ".join(named + others) or "none",
        row["error"] or row["verdict"],
        f"{row['seconds'] or 0.0:.1f}",
    )
    mark = "" if good else ' class="bad"'
    return f"<tr{mark}>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>"


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def confusion_figure(confusion: Mapping[str, Any]) -> Figure:
    """Return the confusion matrix as a picture: right in blue, wrong in orange."""
    names = sorted({*confusion["true"], *confusion["first"]}, key=lambda n: (n[0] == "(", n))
    true = [name for name in names if name in confusion["true"]]
    first = [name for name in names if name in confusion["first"]]
    figure = Figure(figsize=(3.0 + 0.3 * len(first), 2.0 + 0.25 * len(true)))
    axes = figure.add_subplot()
    for row, column, count in confusion["counts"]:
        x, y = first.index(column), true.index(row)
        color = BLUE if agrees(row, column) else ORANGE
        axes.add_patch(_square(x, y, color))
        axes.text(x, y, str(count), ha="center", va="center", color="white", fontsize=8)
    axes.set_xlim(-0.5, max(len(first), 1) - 0.5)
    axes.set_ylim(max(len(true), 1) - 0.5, -0.5)
    axes.set_xticks(range(len(first)), first, rotation=90, fontsize=8)
    axes.set_yticks(range(len(true)), true, fontsize=8)
    axes.set_xlabel("first name")
    axes.set_ylabel("true effect")
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.set_axisbelow(True)
    return figure


def _square(x: float, y: float, color: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - 0.45, y - 0.45), 0.9, 0.9, color=color)


def reliability_figure(confidence: Mapping[str, Any]) -> Figure:
    """Return the reliability diagram: share of right names over confidence."""
    figure = Figure(figsize=(5.0, 4.0))
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], "--", color=GREY)
    for k, entry in enumerate(confidence["bins"]):
        x, y = entry["confidence"], entry["share"]
        axes.plot([x, x], [entry["low"], entry["high"]], color=BLUE)
        axes.plot(x, y, "o", color=BLUE)
        axes.annotate(
            f"{entry['hits']}/{entry['total']}",
            (x, 0.04 + 0.06 * (k % 2)),
            ha="center",
            fontsize=8,
        )
    axes.set_xlim(0.0, 1.03)
    axes.set_ylim(0.0, 1.03)
    axes.set_xlabel("confidence")
    axes.set_ylabel("share of right names")
    return figure


def shrink_figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Return predicted over true shrink, with the intervals that were predicted."""
    figure = Figure(figsize=(5.0, 4.0))
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], "--", color=GREY)
    for row in rows:
        if s := row["shrink"]:
            low, high = np.clip([s["low"], s["high"]], -0.2, 1.0)
            axes.plot([s["true"], s["true"]], [low, high], color=BLUE, alpha=0.4)
            axes.plot(s["true"], max(s["predicted"], -0.2), "o", color=BLUE, markersize=4)
    axes.set_xlabel("true shrink")
    axes.set_ylabel("predicted shrink")
    return figure
