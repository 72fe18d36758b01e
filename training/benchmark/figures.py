"""Figures of the benchmark's report, as SVG text, from the results of its cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np

from cjt_gym.datasheet.drawing import INK, canvas
from cjt_gym.datasheet.notation import drawn
from cjt_gym.training.report.figures import WIDTH

Result = Mapping[str, Any]
BRIGHT = ("#1f5fa8", "#d07c2e", "#3d8f5f", "#8d4fa8", "#b03a48", "#5b8fb9")
PALE = "#a6a6a6"
COLUMNS_OF_TASKS, BEST = 2, 3
"""Tasks side by side, and how many of the best agents are drawn: more cannot be told apart."""
WORST = 4.0  # how many times worse than the best is darkest


def _colour(place: int) -> str:
    return BRIGHT[place] if place < len(BRIGHT) else PALE


def _floats(values: Sequence[float | None]) -> Any:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def trace_figure(results: Sequence[Result], tasks: Sequence[str]) -> str:
    """Return the first episode of every task under the best agents and the last."""
    rows = -(-len(tasks) // COLUMNS_OF_TASKS)
    chosen = [*results[:BEST], *results[BEST:][-1:]]
    with canvas(WIDTH, 1.9 * rows + 0.4) as (figure, written):
        axes = figure.subplots(rows, COLUMNS_OF_TASKS, squeeze=False).ravel()
        for axis, task in zip(axes, tasks, strict=False):
            for place, result in enumerate(chosen):
                run = result["shown"].get(task)
                if run is not None:
                    colour = PALE if place == len(chosen) - 1 and place else _colour(place)
                    t, tau = _floats(run["t"]), _floats(run["tau"])
                    axis.plot(t, tau, color=colour, linewidth=0.9, label=_label(result))
            run = next((r["shown"][task] for r in chosen if task in r["shown"]), None)
            if run is not None:
                t, wanted = _floats(run["t"]), _floats(run["reference"])
                axis.plot(t, wanted, color=INK, linewidth=0.7, linestyle=":", label="reference")
            axis.set_title(task.replace("_", " "), fontsize=9)
        for axis in axes[len(tasks) :]:
            axis.set_visible(False)
        for k in range(0, len(axes), COLUMNS_OF_TASKS):
            axes[k].set_ylabel("joint torque [N m]")
        for axis in axes[max(len(tasks) - COLUMNS_OF_TASKS, 0) : len(tasks)]:
            axis.set_xlabel("time [s]")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        return written()


def bode_figure(results: Sequence[Result]) -> str:
    """Return gain and phase from reference to torque: simulated sweep and linear model."""
    with canvas(WIDTH, 4.2) as (figure, written):
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.5, 1.0))
        for place, result in reversed(list(enumerate(results))):
            named = place < len(BRIGHT)
            for kind, style, width in (("sweep", "-", 1.2), ("linear", "--", 0.7)):
                curve = result.get(kind)
                if not curve or curve.get("f") is None:
                    continue
                if kind == "linear" and not named:
                    continue
                f, gain, phase = (_floats(curve[name]) for name in ("f", "gain", "phase"))
                label = _label(result) if named and kind == "sweep" else None
                look = {"color": _colour(place), "linestyle": style, "linewidth": width}
                upper.semilogx(f, 20.0 * np.log10(np.maximum(gain, 1e-6)), label=label, **look)
                lower.semilogx(f, np.where(phase > -720.0, phase, np.nan), **look)
        upper.axhline(-3.0, color=INK, linewidth=0.6, linestyle=":")
        upper.set_ylim(-40.0, 20.0)
        upper.set_xlim(1.0, 200.0)
        upper.set_ylabel("gain [dB]")
        lower.set_ylabel("phase [deg]")
        lower.set_xlabel("frequency [Hz]")
        handles, labels = upper.get_legend_handles_labels()
        figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=3)
        return written()


def spectrum_figure(results: Sequence[Result], tasks: Sequence[str]) -> str:
    """Return the spectrum of the error of the best agents and the last, in bands."""
    shown = [task for task in tasks if all(task in r["spectra"] for r in results)][:3]
    with canvas(WIDTH, 2.8) as (figure, written):
        axes = figure.subplots(1, max(len(shown), 1), sharey=True, squeeze=False)[0]
        for axis, task in zip(axes, shown, strict=False):
            for place, result in reversed(list(enumerate(results))):
                curve = result["spectra"][task]
                label = _label(result) if place < len(BRIGHT) else None
                axis.loglog(
                    _floats(curve["f"]), _floats(curve["rms"]), color=_colour(place), label=label
                )
            axis.set_title(task.replace("_", " "), fontsize=9)
            axis.set_xlabel("frequency [Hz]")
        axes[0].set_ylabel("error in band, rms [N m]")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=3)
        return written()


def heat_figure(
    names: Sequence[str], columns: Sequence[str], values: Any, better_high: Sequence[bool]
) -> str:
    """Return a heat map: each column relative to its best, white, up to four times worse, dark.

    Values have the shape (agents, metrics), NaN where there is none; `better_high` tells of which
    metrics more is better.
    """
    values = np.asarray(values, dtype=float)
    worse = np.full(values.shape, np.nan)
    for j, high in enumerate(better_high):
        column = values[:, j]
        finite = column[np.isfinite(column) & (column > 0.0)]
        if len(finite):
            ratio = finite.max() / column if high else column / finite.min()
            worse[:, j] = np.log(np.clip(ratio, 1.0, WORST)) / np.log(WORST)
    with canvas(WIDTH, 0.8 + 0.24 * len(names)) as (figure, written):
        axis: Any = figure.subplots()
        shades = matplotlib.colormaps["Blues"].with_extremes(bad="#f4f4f4")
        axis.imshow(worse, aspect="auto", cmap=shades, vmin=0.0, vmax=1.25)
        for (i, j), value in np.ndenumerate(values):
            text = "-" if np.isnan(value) else f"{value:.3g}"
            dark = np.isfinite(worse[i, j]) and worse[i, j] > 0.8
            axis.text(
                j, i, text, ha="center", va="center", fontsize=7, color="white" if dark else INK
            )
        axis.set_xticks(range(len(columns)), columns, rotation=35, ha="right", fontsize=8)
        axis.set_yticks(range(len(names)), [n.replace("_", " ") for n in names], fontsize=8)
        axis.tick_params(length=0)
        axis.grid(visible=False)
        for side in axis.spines.values():
            side.set_visible(False)
        return written()


def _label(result: Result) -> str:
    return drawn(str(result["agent"]).replace("_", " "))
