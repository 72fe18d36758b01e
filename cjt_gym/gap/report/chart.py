"""Line and dot charts as inline SVG that fit any width, print sharply and need no script.

The curves lie in an SVG that is stretched to its box, with strokes that are not; all text is HTML.
So a chart has the same letters on a wide screen, a narrow one and on paper. `chart.js` adds zoom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise

import numpy as np

from cjt_gym.gap.report.words import MINUS, number
from cjt_gym.joint.arrays import Floats

SIZE = 10_000
"""Units of the drawing along each side."""
MOST = 4000
"""Most points of a curve."""
MARGIN = 0.05
OUTER = 0.003
"""Share of the dots of a cloud that may lie beyond each end of the axis."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One line, or cloud of dots, of a chart."""

    label: str  # its entry in the legend; empty for none
    style: str  # class of its colours: measured, before, after or law
    x: Floats  # shape (N,)
    y: Floats  # shape (N,)
    dots: bool = False  # whether points are drawn instead of a line


@dataclass(frozen=True, eq=False)
class Chart:
    """A chart."""

    title: str  # what it shows
    aid: str  # how it is read, one line
    x_label: str  # quantity and unit
    y_label: str  # quantity and unit
    curves: Sequence[Curve]  # what is drawn
    log_x: bool = False  # whether x is logarithmic
    zoom: str = ""  # name of the group of charts that are zoomed together; empty for none
    # values of x that are marked with a text
    marks: Sequence[tuple[float, str]] = field(default=())
    from_zero: bool = False  # whether y begins at zero


@dataclass(frozen=True)
class _Scale:
    """A map from values to units of the drawing."""

    low: float
    high: float
    log: bool

    def __call__(self, value: float) -> float:
        if self.log:
            share = math.log(value / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return min(max(share, 0.0), 1.0) * SIZE


def draw(chart: Chart) -> str:
    """Return a chart as HTML."""
    x_low, x_high = _range([_bulk(c, c.x) for c in chart.curves])
    y_low, y_high = _range([_bulk(c, c.y) for c in chart.curves], MARGIN)
    if chart.from_zero:
        y_low = 0.0
    across, along = _Scale(x_low, x_high, chart.log_x), _Scale(y_low, y_high, False)
    x_ticks = decades(x_low, x_high) if chart.log_x else ticks(x_low, x_high)
    y_ticks = ticks(y_low, y_high)
    grid = "".join(f"M{across(x):.0f} 0V{SIZE}" for x in x_ticks)
    grid += "".join(f"M0 {SIZE - along(y):.0f}H{SIZE}" for y in y_ticks)
    paths = "".join(_path(c, across, along) for c in chart.curves)
    marks = "".join(
        f"<i class=mark style='left:{across(x) / SIZE:.2%}'><b>{escape(text)}</b></i>"
        for x, text in chart.marks
        if x_low <= x <= x_high
    )
    zoomed = f" data-zoom='{escape(chart.zoom, quote=True)}'" if chart.zoom else ""
    return (
        f"<figure class=chart{zoomed} data-x='{x_low!r} {x_high!r}' data-y='{y_low!r} {y_high!r}'>"
        f"<figcaption><b>{escape(chart.title)}</b><span>{escape(chart.aid)}</span></figcaption>"
        f"{_legend(chart.curves)}<div class=y-label>{escape(chart.y_label)}</div>"
        f"<div class=plot><div class=y-ticks>{_labels(y_ticks, along, 'bottom')}</div>"
        f"<div class=area><svg viewBox='0 0 {SIZE} {SIZE}' preserveAspectRatio=none role=img "
        f"aria-label='{escape(chart.title, quote=True)}'><path class=grid d='{grid}'/>{paths}</svg>"
        f"{marks}</div></div><div class=x-ticks>{_labels(x_ticks, across, 'left')}</div>"
        f"<div class=x-label>{escape(chart.x_label)}</div></figure>"
    )


def _legend(curves: Sequence[Curve]) -> str:
    entries = "".join(
        f"<span class={c.style}{' data-dots' if c.dots else ''}>{escape(c.label)}<output></output>"
        "</span>"
        for c in curves
        if c.label
    )
    return f"<div class=legend>{entries}</div>"


def _labels(values: Sequence[float], place: _Scale, side: str) -> str:
    texts = tick_texts(values)
    return "".join(
        f"<span style='{side}:{place(v) / SIZE:.2%}'>{text}</span>"
        for v, text in zip(values, texts, strict=True)
    )


def tick_texts(values: Sequence[float]) -> list[str]:
    """Return the labels of ticks, all with the same number of decimals where they are even."""
    if len(values) < 2:
        return [number(v) for v in values]
    step = min(abs(b - a) for a, b in pairwise(values))
    top = max(abs(v) for v in values)
    if top >= 1e6 or top < 1e-4 or values[-1] > 50.0 * step:
        return [number(v, 1 if top >= 1e6 or top < 1e-4 else 3).rstrip() for v in values]
    decimals = max(-math.floor(math.log10(step) + 1e-9), 0)
    return [f"{v + 0.0:.{decimals}f}".replace("-", MINUS) for v in values]


def _path(curve: Curve, across: _Scale, along: _Scale) -> str:
    x, y = decimated(curve.x, curve.y, curve.dots)
    if curve.dots:
        inside = (x >= across.low) & (x <= across.high) & (y >= along.low) & (y <= along.high)
        x, y = x[inside], y[inside]
    points = [(across(float(a)), SIZE - along(float(b))) for a, b in zip(x, y, strict=True)]
    if curve.dots:
        d = "".join(f"M{a:.0f} {b:.0f}h0" for a, b in points)
    else:
        d = "M" + " ".join(f"{a:.1f} {b:.0f}" for a, b in points)
    kind = "dots" if curve.dots else "line"
    return f"<path class='{kind} {curve.style}' d='{d}'/>"


def decimated(x: Floats, y: Floats, dots: bool = False) -> tuple[Floats, Floats]:
    """Return at most `MOST` points of a curve: a subset of a cloud, the extremes of a line."""
    if dots:
        step = max(len(x) * 3 // MOST, 1)
        return x[::step], y[::step]
    if len(x) <= MOST:
        return x, y
    edges = np.linspace(0, len(x), MOST // 2 + 1).astype(np.int64)
    kept = np.empty((MOST // 2, 2), dtype=np.int64)
    for k, (start, end) in enumerate(pairwise(edges)):
        piece = y[start:end]
        kept[k] = start + int(np.argmin(piece)), start + int(np.argmax(piece))
    index = np.unique(np.sort(kept, axis=1))
    return x[index], y[index]


def ticks(low: float, high: float) -> list[float]:
    """Return about six round values between two ends."""
    step = _round_up((high - low) / 6)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def decades(low: float, high: float) -> list[float]:
    """Return round values between two positive ends for a logarithmic axis."""
    span = math.log10(high / low)
    factors = (1.0,) if span > 3.0 else (1.0, 3.0) if span > 1.5 else (1.0, 2.0, 5.0)
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found = [f * 10.0**k for k in powers for f in factors]
    return [v for v in found if low <= v <= high]


def _round_up(step: float) -> float:
    power = 10.0 ** math.floor(math.log10(step))
    return next(power * f for f in (1.0, 2.0, 5.0, 10.0) if power * f >= step * (1.0 - 1e-9))


def _bulk(curve: Curve, values: Floats) -> Floats:
    """Return the values that an axis must cover: for a cloud all but its few outermost dots."""
    return np.quantile(values, [OUTER, 1.0 - OUTER]) if curve.dots else values


def _range(parts: Sequence[Floats], margin: float = 0.0) -> tuple[float, float]:
    low = min(float(p.min()) for p in parts)
    high = max(float(p.max()) for p in parts)
    room = margin * (high - low)
    if high - low <= 1e-12 * max(abs(low), abs(high)) or high == low:
        room = 0.5 * abs(low) or 1.0
    return low - room, high + room
