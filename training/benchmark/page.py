"""The report of a benchmark: one self-contained page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cjt_gym.datasheet.blocks import Block
from cjt_gym.training import report
from cjt_gym.training.benchmark import figures
from cjt_gym.training.evaluation.ranking import Place
from cjt_gym.training.evaluation.tasks import BENCHMARK_TASKS

Result = Mapping[str, Any]
CHARACTER = (
    ("bandwidth [Hz]", "bandwidth_hz", True),
    ("overshoot", "overshoot", False),
    ("settling [s]", "settling_s", False),
    ("noise", "noise_amplification", False),
)
MARGINS = (
    ("gain margin", "gain_margin", 1.0),
    ("phase margin [deg]", "phase_margin", 1.0),
    ("delay margin [ms]", "delay_margin", 1e3),
    ("Ms", "sensitivity_peak", 1.0),
    ("bandwidth [Hz]", "bandwidth_hz", 1.0),
    ("overshoot", "overshoot", 1.0),
    ("disturbance", "disturbance", 1.0),
    ("rejection [Hz]", "rejection_hz", 1.0),
    ("noise", "noise_amplification", 1.0),
    ("port lacks [N m s/rad]", "port_shortage", 1.0),
    ("stiffest [N m/rad]", "stiffest", 1.0),
)


def write_benchmark_report(
    path: Path,
    groups: Mapping[tuple[str, str], tuple[list[Place], list[Result], list[dict[str, Any]]]],
    others: Sequence[Result],
    facts: Sequence[str],
) -> Path:
    """Write the page and return its path.

    `groups` has by joint and structure the ranking, the cells of the first seed with the best agent
    first, and the rows of the benchmark; `others` are the cells that were refused or failed,
    `facts` sentences about what was run.
    """
    parts: list[Block] = [report.paragraph(text) for text in facts]
    parts.append(report.html_table(_tasks(groups)))
    for (joint, structure), (places, results, rows) in groups.items():
        parts.append(report.heading(f"{joint}, {structure.replace('_', ' ')}"))
        parts += _group(places, results, rows)
    if others:
        parts.append(report.heading("Refused and failed"))
        cells = [["agent", "joint", "structure", "", "why"]]
        for other in others:
            cell = other["cell"]
            cells.append(
                [
                    other["agent"],
                    cell["joint"],
                    cell["structure"],
                    other["status"],
                    other["why"],
                ]
            )
        parts.append(report.html_table(cells))
    return report.write_page(path, "Benchmark of torque controllers", parts)


def _tasks(groups: Mapping[Any, tuple[Any, list[Result], Any]]) -> list[list[str]]:
    seen = {task for _, results, _ in groups.values() for r in results for task in r["squares"]}
    return [["task", "what it is"]] + [
        [name, row.summary] for name, row in BENCHMARK_TASKS.items() if name in seen
    ]


def ranking_cells(places: Sequence[Place]) -> list[list[str]]:
    """Return a ranking as cells of a table with a head."""
    cells = [["rank", "agent", "score", "95 % interval", "against the next", "significant"]]
    for place in places:
        against, clear = "-", "-"
        if place.to_next is not None:
            against = f"{place.to_next:.3f} ({place.to_next_low:.3f} .. {place.to_next_high:.3f})"
            clear = {None: "-", True: "yes", False: "no"}[place.next_is_worse]
        interval = f"{place.low:.3f} .. {place.high:.3f}"
        cells.append([str(place.rank), place.agent, f"{place.score:.3f}", interval, against, clear])
    return cells


def _group(places: list[Place], results: list[Result], rows: list[dict[str, Any]]) -> list[Block]:
    tasks = [t for t in BENCHMARK_TASKS if any(t in r["squares"] for r in results)]
    names = [result["agent"] for result in results]
    values, columns, high = _heat(names, tasks, rows)
    ranked = results[: len(places)]
    return [
        report.html_table(ranking_cells(places)),
        report.paragraph(
            "Score: error over the rms of the reference, geometric mean over the tasks that all "
            "agents take part in. Rank: one more than the number of agents that are significantly "
            "better, at 5 % for all comparisons together, and no less than that of an agent with a "
            "better score; equal ranks are ties. Against the next: ratio of the scores over the "
            "same episodes. What renders a spring of its own follows no torque: it takes part in "
            "the task impedance alone, and has no rank.",
            note=True,
        ),
        report.figure(
            figures.heat_figure(names, columns, values, high),
            "Tasks: error over the rms of the reference. The lighter, the nearer to the best of "
            "the column; four times worse and more is darkest.",
        ),
        report.figure(
            figures.trace_figure(ranked, tasks),
            "The first episode of each task: the three best, the last, and the reference. In the "
            "task impedance the reference follows from the motion; that of the best is shown.",
        ),
        report.figure(
            figures.bode_figure(ranked),
            "From reference to joint torque: a sweep on the simulated joint with all its effects "
            "(solid) and the linear loop (dashed, for laws that are linear).",
        ),
        report.figure(figures.spectrum_figure(ranked, tasks), "Where in frequency the error lies."),
        report.html_table(_margins(results)),
        report.paragraph(
            "Linear loop around the nominal joint with its delays and filters, without friction "
            "and ripple. Disturbance: response to a torque at the motor up to 20 Hz, rms. "
            "Rejection: up to where less than 0.7 of it reaches the output. Port lacks: damping "
            "that the environment must add for the output to be passive with zero reference. "
            "Stiffest: virtual spring that is rendered stably and passively against an environment "
            "with a damping of 5 % of sqrt(k_b (I_m + I_g)), the upper end of the Z-width.",
            note=True,
        ),
    ]


def _heat(
    names: Sequence[str], tasks: Sequence[str], rows: Sequence[Mapping[str, Any]]
) -> tuple[list[list[float]], list[str], list[bool]]:
    by = {(row["controller"], row["task"]): row for row in rows}
    values = []
    for name in names:
        first = next(row for row in rows if row["controller"] == name)
        line = [by[name, t]["nrmse"] if (name, t) in by else None for t in tasks]
        line += [first[key] for _, key, _ in CHARACTER]
        values.append([math.nan if v is None else float(v) for v in line])
    columns = [t.replace("_", " ") for t in tasks] + [title for title, _, _ in CHARACTER]
    return values, columns, [False] * len(tasks) + [high for _, _, high in CHARACTER]


def _margins(results: Sequence[Result]) -> list[list[str]]:
    cells = [["linear loop", *(title for title, _, _ in MARGINS)]]
    for result in results:
        linear = result["linear"]
        if linear is None:
            continue
        if not linear["is_linear"]:
            cells.append([result["agent"], "not linear", *[""] * (len(MARGINS) - 1)])
            continue
        line = [result["agent"]]
        for _, name, factor in MARGINS:
            value = linear["figures"][name]
            endless = name in linear["infinite"]
            line.append("inf" if endless else "-" if value is None else f"{factor * value:.3g}")
        cells.append(line)
    return cells
