"""Figures of a comparison, as SVG."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.transforms import Bbox

from cjt_gym.datasheet.drawing import canvas
from cjt_gym.training.report.figures import COLOURS, WIDTH
from experiments.results.score import THRESHOLDS
from experiments.results.tables import Found, ranked

RIVALS = 3
Point = tuple[float, float]
BESIDE: Final = tuple(
    ((x, y), side)
    for y in (-2, 5, -9, 12, -16, 19, -23)
    for x, side in ((6, "left"), (-6, "right"))
)
"""Where a name may stand [points from its point], and which of its sides is there."""


def _some(found: Found) -> dict[str, tuple[str, float]]:
    """Return colour and line width of the policies, the best controllers and the base."""
    order = [name for name in ranked(found) if name != "policy"][:RIVALS]
    base = [found["base"]] if found["base"] in found["score"] else []
    names = list(dict.fromkeys(["policy", *order, *base]))
    colours = (COLOURS[2], COLOURS[1], COLOURS[3], COLOURS[4], COLOURS[0])
    return {
        name: (colour, 1.8 if name == "policy" else 1.0)
        for name, colour in zip(names, colours, strict=False)
    }


def noise_figure(found: Found) -> str:
    """Return score over noise of every agent; those that none beats in both are named."""
    with canvas(WIDTH, 3.4) as (figure, written):
        axes: Any = figure.subplots()
        points, names = [], []
        for name, score in found["score"].items():
            noise = found["noise"][name]
            if noise is None or not np.isfinite(score):
                continue
            points.append((max(noise, 0.1), score))
            axes.plot(*points[-1], "o", color=COLOURS[2] if name == "policy" else COLOURS[0])
            beaten = any(
                other is not None and other < noise and found["score"][who] < score
                for who, other in found["noise"].items()
            )
            if name in _some(found) or not beaten:
                names.append((name.replace("_", " "), points[-1]))
        for axis in (axes.xaxis, axes.yaxis):
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter("{x:g}" if axis is axes.yaxis else "")
        axes.set_xlabel("amplification of the torque sensor's noise")
        axes.set_ylabel("nrmse, geometric mean over tasks")
        _write_beside(axes, names, points)
        return written()


def _write_beside(axes: Any, names: Sequence[tuple[str, Point]], points: Sequence[Point]) -> None:
    """Write names beside their points, each where it covers no point and no other name."""
    axes.figure.draw_without_rendering()
    marks = axes.transData.transform(points)
    taken: list[Bbox] = [Bbox.from_bounds(x - 4.0, y - 4.0, 8.0, 8.0) for x, y in marks]
    for word, at in names:
        for offset, side in BESIDE:
            text = axes.annotate(
                word, at, textcoords="offset points", xytext=offset, fontsize=7, ha=side
            )
            box = text.get_window_extent()
            if not any(box.overlaps(other) for other in taken):
                taken.append(box)
                break
            text.remove()


def profile_figure(found: Found) -> str:
    """Return the performance profiles of the policies and of the best controllers."""
    with canvas(WIDTH, 2.8) as (figure, written):
        axes: Any = figure.subplots()
        for name, (colour, width) in _some(found).items():
            row = found["profile"][name]
            text = name.replace("_", " ")
            axes.semilogx(THRESHOLDS, row["value"], color=colour, linewidth=width, label=text)
            axes.fill_between(THRESHOLDS, row["low"], row["high"], color=colour, alpha=0.15)
        axes.set_xlabel("threshold of the nrmse")
        axes.set_ylabel("share of episodes below")
        axes.legend(loc="lower right")
        return written()


def delay_figure(found: Found) -> str:
    """Return the score against the delay on top of that of the command."""
    rows = [row for row in found["shifts"] if "delay" in row]
    with canvas(WIDTH, 2.6) as (figure, written):
        axes: Any = figure.subplots()
        for name, (colour, width) in _some(found).items():
            known = [
                (1e3 * row["delay"], row["score"][name]) for row in rows if name in row["score"]
            ]
            if known:
                text = name.replace("_", " ")
                axes.plot(*zip(*known, strict=True), "o-", color=colour, lw=width, ms=3, label=text)
        axes.set_yscale("log")
        axes.set_xlabel("more delay [ms]")
        axes.set_ylabel("score")
        axes.legend(loc="upper left")
        return written()


def port_figure(found: Found) -> str:
    """Return the damping felt at the output over frequency."""
    agents = found["port"]["agents"]
    with canvas(WIDTH, 2.6) as (figure, written):
        axes: Any = figure.subplots()
        for name, (colour, width) in _some(found).items():
            if name in agents:
                row = agents[name]["resistance"]
                text = name.replace("_", " ")
                f = [float(key) for key in row]
                axes.semilogx(f, list(row.values()), "o-", color=colour, lw=width, ms=3, label=text)
        axes.axhline(0.0, color=COLOURS[0], linewidth=0.8)
        axes.set_yscale("symlog", linthresh=0.1)
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel("damping / sqrt(stiffness x inertia)")
        axes.legend(loc="upper left")
        return written()
