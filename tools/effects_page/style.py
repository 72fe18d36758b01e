"""How all figures look, and how they are written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cjt_gym.datasheet.drawing import STYLE as SHEETS
from tools.effects_page.bench import Complexes, Floats, decibel, degrees, density

WIDTH = 7.0  # inches, 672 px
BLUE, RED, GREEN, GOLD, GREY, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#B8860B",
    "#8A8A8A",
    "#222222",
)
SEQUENCE = (BLUE, RED, GREEN, GOLD)

POINTS: dict[str, Any] = {"ls": "none", "marker": "o", "ms": 3.4, "mew": 0.0}
LAW: dict[str, Any] = {"color": BLACK, "lw": 1.0}
NOMINAL: dict[str, Any] = {"color": GREY, "lw": 1.0, "ls": (0, (4, 2))}

STYLE: Any = SHEETS | {
    "font.family": "DejaVu Sans",
    "mathtext.fontset": "dejavusans",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.6,
    "legend.labelspacing": 0.5,
    "lines.linewidth": 1.3,
    "path.simplify_threshold": 0.2,
}
"""The style of data sheets, for figures that are seen on a screen."""


def mosaic(layout: str, height: float = 2.7, **more: Any) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with axes by letter, such as "ab" or "ag;ap".

    Args:
        layout: Rows of letters, separated by semicolons.
        height: Height of the figure [inch].
        **more: Arguments of `Figure.subplot_mosaic`.
    """
    mpl.rcParams.update(STYLE)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes: dict[str, Axes] = figure.subplot_mosaic(layout, **more)
    return figure, axes


def bode(height: float = 3.0) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with a panel "a" and a gain "g" over a phase "p" against log frequency."""
    figure, axes = mosaic("ag;ap", height)
    axes["g"].set_xscale("log")
    axes["p"].set_xscale("log")
    axes["g"].sharex(axes["p"])
    axes["g"].tick_params(labelbottom=False)
    axes["g"].set_ylabel("gain [dB]")
    label(axes["p"], "frequency [Hz]", "phase [deg]")
    return figure, axes


def draw_response(
    axes: dict[str, Axes],
    law: tuple[Floats, Complexes],
    found: tuple[Floats, Complexes],
    color: str,
    /,
    **line: Any,
) -> None:
    """Draw a frequency response into the panels "g" and "p", as a line and as points.

    Args:
        axes: Panels.
        law: Frequencies [Hz] and values of the line.
        found: Frequencies [Hz] and values of the points.
        color: Color of both.
        **line: Style of the line.
    """
    for panel, of in ((axes["g"], decibel), (axes["p"], degrees)):
        panel.plot(law[0], of(law[1]), **({"color": color, "lw": 0.9} | line))
        panel.plot(found[0], of(found[1]), **POINTS, color=color)


def draw_noise(axes: dict[str, Axes], x: Floats, std: float, dt: float, low: float) -> None:
    """Draw the distribution of white noise into panel "b", and its density into "c".

    Args:
        axes: Panels.
        x: Samples.
        std: Their standard deviation.
        dt: Sample time [s].
        low: Lower end of the axis of the density.
    """
    y = np.linspace(-4.0, 4.0, 81)
    axes["b"].hist(x / std, 40, density=True, color=BLUE, alpha=0.45)
    axes["b"].plot(y, np.exp(-0.5 * y * y) / np.sqrt(2.0 * np.pi), **LAW)
    label(axes["b"], "noise / std [-]", "density [-]", "normal")
    f, power = density(x, dt, 1000)
    axes["c"].loglog(f[::7], power[::7], **POINTS, color=BLUE)
    axes["c"].axhline(2.0 * std * std * dt, **LAW)
    axes["c"].set_ylim(low, 1e-3)
    label(axes["c"], "frequency [Hz]", "density [N² m²/Hz]", "white: 2 std² dt")


def label(axes: Axes, x: str, y: str, title: str = "", legend: Any = None) -> None:
    """Name the axes, and place a legend where one is asked for."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title)
    if legend is not None:
        axes.legend(loc=legend)


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as SVG and return its path."""
    mpl.rcParams.update(STYLE)
    path.parent.mkdir(parents=True, exist_ok=True)
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(path, metadata=nothing)
    path.write_text(compact(path.read_text(encoding="utf-8")), encoding="utf-8")
    return path


def compact(text: str) -> str:
    """Return an SVG with coordinates to a hundredth of a point and without what is not drawn."""
    text = re.sub(r"(?<!scale\()-?\d+\.\d{3,}", _short, text)
    text = re.sub(r"(translate\(-?\d+)\.\d+( 0\)\"/>)", r"\1\2", text)
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r' id="[A-Za-z.]*2?d?[A-Za-z]*_\d+"', "", text)
    text = re.sub(r"\s*\n\s*", "\n", text).replace("DejaVuSans-", "s")
    for k, name in enumerate(dict.fromkeys(re.findall(r"url\(#(\w+)\)", text))):
        text = text.replace(name, f"k{k}")
    rules = []
    for k, style in enumerate(dict.fromkeys(re.findall(r'style="([^"]*)"', text))):
        if text.count(f'style="{style}"') > 2:
            text = text.replace(f'style="{style}"', f'class="c{k}"')
            rules.append(f".c{k}{{{style}}}")
    text = text.replace("</style>", "".join(rules) + "</style>", 1)
    return re.sub(r"\n(?=[MLQCSz] ?[\d.-]*|\")", " ", text).strip() + "\n"


def _short(match: re.Match[str]) -> str:
    return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")
