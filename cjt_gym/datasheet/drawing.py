"""How the figures of a sheet look."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

HALF, WHOLE = 3.42, 6.95  # inches
COLOURS = ("#1f5fa8", "#d07c2e", "#3d8f5f", "#8d4fa8", "#b03a48", "#6b6b6b")
BLUE, ORANGE, GREEN, VIOLET, RED, GREY = COLOURS
INK = "#222222"
STYLE: Any = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#444444",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.0,
    "legend.frameon": True,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.2,
    "legend.handlelength": 1.5,
    "legend.labelspacing": 0.3,
    "lines.linewidth": 1.2,
    "svg.fonttype": "path",
    "svg.hashsalt": "cjt-gym",
}


@contextmanager
def canvas(width: float = HALF, height: float = 2.55) -> Iterator[tuple[Figure, Callable[[], str]]]:
    """Yield a figure in the style of the sheets, its size in inches, and what writes it as SVG."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")

        def written() -> str:
            buffer = io.StringIO()
            figure.savefig(buffer, format="svg", metadata={"Date": None})
            text = buffer.getvalue()
            return text[text.index("<svg") :]

        yield figure, written


def legend(axes: Axes, **more: Any) -> None:
    """Place a legend, where there is anything to name."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**({"loc": "best"} | more))
