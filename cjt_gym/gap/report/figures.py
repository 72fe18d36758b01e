"""The charts of a report, from the evidence of a diagnosis, as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.evidence import FrictionMap, RippleSpectrum, Source, SpringLoop
from cjt_gym.gap.report.drawing import OUTER, SOFT, Curve, log_x, plot
from cjt_gym.gap.report.words import CHANNELS, MINUS, number, percent
from cjt_gym.joint.kernel.arrays import Floats

BEFORE, AFTER = "datasheet", "with the effects"
STANDS_OUT = 6.0
"""Height of a line over the median of its spectrum from which it is shown unasked."""
SHADE: Any = {"color": SOFT, "alpha": 0.2, "linewidth": 0.0}
ENLARGED, LEAST, MOST = 0.05, 200, 0.3
"""Share of a replay that is enlarged; at least this number of samples, but at most this share."""


def figure(title: str, aid: str, *pictures: str) -> str:
    """Return pictures with their title and a line on how they are read."""
    return (
        f"<figure class=chart><figcaption><b>{escape(title)}</b><span>{escape(aid)}</span>"
        f"</figcaption>{''.join(pictures)}</figure>"
    )


def replay_charts(diagnosis: Diagnosis) -> list[str]:
    """Return measured against replayed signals, each whole and enlarged where it is worst."""
    evidence = diagnosis.evidence
    source = evidence.source
    units = {"dq_m": f"{source.angle}/s", "q_m": source.angle, "i": "A"}
    models = [("before", BEFORE), ("after", AFTER)] if diagnosis.effects else [("before", BEFORE)]
    charts = []
    for name, text in CHANNELS.items():
        signals = evidence.replays.get(name)
        if signals is None or (name == "i" and not diagnosis.stages["drive"].significant):
            continue
        t = np.arange(len(signals["measured"]), dtype=np.float64) * evidence.replay_dt
        shown = [("measured", "measured"), *models]
        curves = [Curve(label, key, t, signals[key]) for key, label in shown]
        aid = "Held-out stretches, one after the other, each from a measured start."
        if not evidence.restarted:
            errors = [relative(signals[key], signals["measured"]) for key, _ in models]
            aid = f"Error {' before, '.join(percent(e) for e in errors)}"
            aid += " after, relative to the signal." if len(errors) > 1 else " of the signal."
        label = f"{text} [{units.get(name, source.torque)}]"
        pictures = _whole_and_enlarged(text.capitalize(), label, curves, worst(signals))
        charts.append(figure(text.capitalize(), aid, *pictures))
    return charts


def _whole_and_enlarged(
    title: str, label: str, curves: Sequence[Curve], stretch: slice
) -> tuple[str, str]:
    """Return a replay whole, with a stretch of it shaded, and that stretch enlarged."""
    labels, start, end = ("time [s]", label), *curves[0].x[stretch][[0, -1]]
    cut = [c._replace(x=c.x[stretch], y=c.y[stretch]) for c in curves]
    return (
        plot(title, *labels, curves, lambda axes: axes.axvspan(start, end, **SHADE)),
        plot(f"{title}, enlarged", *labels, cut),
    )


def worst(signals: Mapping[str, Floats]) -> slice:
    """Return the stretch of a replay in which the datasheet's error is largest."""
    squares = (signals["before"] - signals["measured"]) ** 2
    whole = len(squares)
    size = max(round(ENLARGED * whole), min(LEAST, round(MOST * whole)), 1)
    start = int(np.argmax(np.convolve(squares, np.ones(size), "valid")))
    return slice(start, start + size)


def relative(model: Floats, measured: Floats) -> float:
    """Return the rms error of a model relative to the rms of what was measured."""
    scale = max(float(np.linalg.norm(measured)), 1e-300)
    return float(np.linalg.norm(model - measured)) / scale


def friction_charts(diagnosis: Diagnosis) -> list[str]:
    """Return the friction maps of stages with a gap."""
    stages = diagnosis.stages
    source = diagnosis.evidence.source
    found = [m for m in diagnosis.evidence.friction if stages[m.stage].significant]
    return [_friction(m, source, bool(diagnosis.effects)) for m in found]


def _friction(found: FrictionMap, source: Source, explained: bool) -> str:
    curves = [Curve(BEFORE, "before", found.speed, found.before, dots=True)]
    if explained:
        curves.append(Curve(AFTER, "after", found.speed, found.after, dots=True))
    if explained and np.ptp(found.law) > 0.01 * np.ptp(found.before):
        low, high = np.quantile(found.speed, [OUTER, 1.0 - OUTER])
        seen = (found.law_speed >= low) & (found.law_speed <= high)
        curves.append(Curve("fitted friction", "law", found.law_speed[seen], found.law[seen]))
    title = f"Unexplained torque of the {found.stage} over velocity"
    aid = "Friction is a step at zero, damping a slope; explained, a flat band round zero is left."
    labels = f"velocity [{source.angle}/s]", f"resisting torque [{source.torque}]"
    return figure(title, aid, plot(title, *labels, curves))


def ripple_charts(diagnosis: Diagnosis) -> list[str]:
    """Return the spectrum over the angle, where it has a line or ripple is named."""
    spectrum = diagnosis.evidence.ripple
    if spectrum is None or not diagnosis.stages["motor"].significant:
        return []
    named = any(e.name in ("cogging", "gear_ripple") for e in diagnosis.effects)
    outstanding = float(spectrum.before.max()) > STANDS_OUT * float(np.median(spectrum.before))
    return [_ripple(spectrum, diagnosis)] if named or outstanding else []


def _ripple(spectrum: RippleSpectrum, diagnosis: Diagnosis) -> str:
    source, cycles = diagnosis.evidence.source, spectrum.cycles
    title = "Torque that repeats with the motor's angle"
    aid = "A line stands for cogging or gear ripple; a slope to the left for friction."
    curves = [
        Curve(BEFORE, "before", cycles, spectrum.before),
        Curve(AFTER, "after", cycles, spectrum.after),
    ]
    shown = curves if diagnosis.effects else curves[:1]
    peak = int(np.argmax(spectrum.before))
    top = float(cycles[peak]), float(spectrum.before[peak])

    def finish(axes: Axes) -> None:
        axes.set_ylim(bottom=0.0)
        log_x(axes)
        axes.annotate(number(top[0]), top, (4.0, 0.0), textcoords="offset points", weight="bold")

    x_label = "cycles per revolution" if source.angle == "rad" else "cycles per 2π m"
    picture = plot(title, x_label, f"amplitude [{source.torque}]", shown, finish)
    return figure(title, aid, picture)


def spring_charts(diagnosis: Diagnosis) -> list[str]:
    """Return the loops of the spring, where the transmission or its sensor has a gap."""
    loop = diagnosis.evidence.spring
    stages = diagnosis.stages
    if loop is None or not (stages["transmission"].significant or stages["sensing"].significant):
        return []
    source = diagnosis.evidence.source
    x_label = f"deflection [m{source.angle}]"
    line = loop.stiffness * loop.deflection
    rows = (
        (
            "Torque over deflection",
            "The datasheet's spring is a straight line; play, hysteresis and hardening bend it.",
            f"joint torque [{source.torque}]",
            0.0 * line,
        ),
        (
            "Departure from the datasheet's straight line",
            "A loop is hysteresis, a step is play, a curve is hardening, a slope is stiffness.",
            f"torque {MINUS} k_b · deflection [{source.torque}]",
            line,
        ),
    )
    return [
        figure(title, aid, plot(title, x_label, y_label, _loops(loop, less, diagnosis)))
        for title, aid, y_label, less in rows
    ]


def _loops(loop: SpringLoop, line: Floats, diagnosis: Diagnosis) -> list[Curve]:
    x = 1e3 * loop.deflection
    curves = [
        Curve("measured", "measured", x, loop.measured - line, dots=True),
        Curve(BEFORE, "before", x, loop.before - line, dots=True),
        Curve(AFTER, "after", x, loop.after - line, dots=True),
    ]
    return curves if diagnosis.effects else curves[:2]
