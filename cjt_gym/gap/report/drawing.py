"""Matplotlib figures as SVG that takes the colours and the font of the page around it."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from html import escape
from itertools import count
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from cjt_gym.joint.kernel.arrays import Floats

COLOURS: Mapping[str, str] = {
    "paper": "#ffffff",
    "ink": "#1c2128",
    "soft": "#59636e",
    "faint": "#e4e8ec",
    "before": "#d1495b",
    "after": "#0b6fb8",
    "law": "#e09f00",
}
"""Colours to draw with; on the page each is the variable of this name in `style.css`."""
PAPER, INK, SOFT, FAINT, BEFORE, AFTER, LAW = COLOURS.values()
STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cjt-gym",
    "path.simplify_threshold": 0.2,
    "text.parse_math": False,  # a name may contain a dollar sign
    "text.color": INK,
    "font.size": 8.5,
    "axes.labelcolor": SOFT,
    "axes.edgecolor": SOFT,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.0,
    "grid.color": FAINT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
}
LINES: Mapping[str, Any] = {
    "measured": {"color": INK, "linewidth": 2.4, "alpha": 0.4},
    "before": {"color": BEFORE, "linewidth": 1.0},
    "after": {"color": AFTER, "linewidth": 1.0},
    "law": {"color": LAW, "linewidth": 1.7},
}
NOTHING: Any = dict.fromkeys(("Creator", "Date", "Format", "Type"))
WIDTH, HEIGHT = 4.5, 2.3
"""Size of a picture that takes half the width of the page [inch]."""
MOST_DOTS = 1300
OUTER = 0.003
"""Share of the dots of a cloud that is left out at each end of either axis."""


class Curve(NamedTuple):
    """A line, or a cloud of dots."""

    label: str
    style: str  # key of LINES
    x: Floats  # shape (N,)
    y: Floats  # shape (N,)
    dots: bool = False


def plot(
    title: str,
    x_label: str,
    y_label: str,
    curves: Sequence[Curve],
    finish: Callable[[Axes], object] = lambda axes: None,
) -> str:
    """Return curves as SVG, with their legend above them.

    Args:
        title: What they show, for readers who cannot see it.
        x_label: Horizontal quantity and its unit.
        y_label: Vertical quantity and its unit.
        curves: What is drawn.
        finish: Draws into the axes what else there is to see.
    """

    def paint(axes: Axes) -> None:
        for label, style, x, y, dots in curves:
            if dots:
                _draw_cloud(axes, label, style, x, y)
            else:
                axes.plot(x, y, label=label, **LINES[style])
        axes.set(xlabel=x_label, ylabel=y_label)
        legend(axes)
        finish(axes)

    return svg(paint, title)


def _draw_cloud(axes: Axes, label: str, style: str, x: Floats, y: Floats) -> None:
    """Draw dots as strokes of no length with round ends: one path, and no markers one by one."""
    step = -(-len(x) // MOST_DOTS)
    inside = np.ones(len(x), dtype=np.bool_)
    for values in (x, y):
        low, high = np.quantile(values, [OUTER, 1.0 - OUTER])
        inside &= (values >= low) & (values <= high)
    x, y = x[inside][::step], y[inside][::step]
    gap = np.full(len(x), np.nan)
    strokes = (np.column_stack([values, values, gap]).ravel() for values in (x, y))
    look = LINES[style] | {"linewidth": 2.0, "alpha": 0.6}
    (line,) = axes.plot(*strokes, label=label, solid_capstyle="round", **look)
    line.get_path().should_simplify = False


def legend(axes: Axes) -> None:
    """Place the legend above the axes."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)


def log_x(axes: Axes) -> None:
    """Make the horizontal axis logarithmic, with ticks at round numbers within its limits."""
    low, high = axes.get_xlim()
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high < 1e3 * low else (1.0,)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()


def svg(
    paint: Callable[[Axes], object], label: str, width: float = WIDTH, height: float = HEIGHT
) -> str:
    """Return a drawing as SVG for the middle of a page, where it is as wide as its place.

    Args:
        paint: Draws into the axes that it is given.
        label: What the picture shows, for readers who cannot see it.
        width: Width by which text is sized [inch].
        height: Height for this width [inch].
    """
    buffer = io.StringIO()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), facecolor="none", layout="constrained")
        paint(figure.subplots())
        figure.savefig(buffer, format="svg", metadata=NOTHING)
    text = buffer.getvalue()
    for name, colour in COLOURS.items():
        text = text.replace(colour, f"var(--{name})")
    text = re.sub(r' d="[^"]*"', _in_hundredths, text[text.index("<svg") :])
    start = rf"<svg \1 role=img aria-label='{escape(label, quote=True)}'>"
    return re.sub(r'<svg [^>]*(viewBox="[^"]*")[^>]*>', start, text, count=1)


def _in_hundredths(path: re.Match[str]) -> str:
    return re.sub(r"\s+", " ", re.sub(r"(\.\d\d)\d+", r"\1", path[0]))


def with_own_ids(page: str) -> str:
    """Return a page in which no two pictures share an identifier."""
    numbers = count(1)

    def renamed(picture: re.Match[str]) -> str:
        prefix = f"f{next(numbers)}-"
        return re.sub(r'( id="|href="#|url\(#)', rf"\g<1>{prefix}", picture[0])

    return re.sub(r"<svg .*?</svg>", renamed, page, flags=re.DOTALL)
