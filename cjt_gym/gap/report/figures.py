"""The charts of a report, from the evidence of a diagnosis."""

from __future__ import annotations

import numpy as np

from cjt_gym.gap.diagnosis import Diagnosis
from cjt_gym.gap.evidence import FrictionMap, RippleSpectrum, Source, SpringLoop
from cjt_gym.gap.report.chart import OUTER, Chart, Curve
from cjt_gym.gap.report.words import CHANNELS, number, percent
from cjt_gym.joint.arrays import Floats

BEFORE, AFTER = "datasheet", "with the effects"
STANDS_OUT = 6.0
"""Height of a line over the median of its spectrum from which it is shown unasked."""


def replay_charts(diagnosis: Diagnosis) -> list[Chart]:
    """Return measured against replayed signals, one chart for each channel."""
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
        charts.append(Chart(text.capitalize(), aid, "time [s]", label, curves, zoom="time"))
    return charts


def relative(model: Floats, measured: Floats) -> float:
    """Return the rms error of a model relative to the rms of what was measured."""
    scale = max(float(np.linalg.norm(measured)), 1e-300)
    return float(np.linalg.norm(model - measured)) / scale


def friction_charts(diagnosis: Diagnosis) -> list[Chart]:
    """Return the friction maps of stages with a gap."""
    stages = diagnosis.stages
    source = diagnosis.evidence.source
    found = [m for m in diagnosis.evidence.friction if stages[m.stage].significant]
    return [_friction(m, source, bool(diagnosis.effects)) for m in found]


def _friction(found: FrictionMap, source: Source, explained: bool) -> Chart:
    curves = [Curve(BEFORE, "before", found.speed, found.before, dots=True)]
    if explained:
        curves.append(Curve(AFTER, "after", found.speed, found.after, dots=True))
    if explained and np.ptp(found.law) > 0.01 * np.ptp(found.before):
        low, high = np.quantile(found.speed, [OUTER, 1.0 - OUTER])
        seen = (found.law_speed >= low) & (found.law_speed <= high)
        curves.append(Curve("fitted friction", "law", found.law_speed[seen], found.law[seen]))
    return Chart(
        f"Unexplained torque of the {found.stage} over velocity",
        "Friction is a step at zero, damping a slope; explained, a flat band round zero is left.",
        f"velocity [{source.angle}/s]",
        f"resisting torque [{source.torque}]",
        curves,
    )


def ripple_charts(diagnosis: Diagnosis) -> list[Chart]:
    """Return the spectrum over the angle, where it has a line or ripple is named."""
    spectrum = diagnosis.evidence.ripple
    if spectrum is None or not diagnosis.stages["motor"].significant:
        return []
    named = any(e.name in ("cogging", "gear_ripple") for e in diagnosis.effects)
    outstanding = float(spectrum.before.max()) > STANDS_OUT * float(np.median(spectrum.before))
    return [_ripple(spectrum, diagnosis)] if named or outstanding else []


def _ripple(spectrum: RippleSpectrum, diagnosis: Diagnosis) -> Chart:
    source = diagnosis.evidence.source
    peak = float(spectrum.cycles[int(np.argmax(spectrum.before))])
    return Chart(
        "Torque that repeats with the motor's angle",
        "A line stands for cogging or gear ripple; a slope to the left for friction.",
        "cycles per revolution" if source.angle == "rad" else "cycles per 2π m",
        f"amplitude [{source.torque}]",
        _two(spectrum.cycles, spectrum.before, spectrum.after, diagnosis),
        log_x=True,
        marks=[(peak, number(peak))],
        from_zero=True,
    )


def _two(x: Floats, before: Floats, after: Floats, diagnosis: Diagnosis) -> list[Curve]:
    curves = [Curve(BEFORE, "before", x, before), Curve(AFTER, "after", x, after)]
    return curves if diagnosis.effects else curves[:1]


def spring_charts(diagnosis: Diagnosis) -> list[Chart]:
    """Return the loops of the spring, where the transmission or its sensor has a gap."""
    loop = diagnosis.evidence.spring
    stages = diagnosis.stages
    if loop is None or not (stages["transmission"].significant or stages["sensing"].significant):
        return []
    source = diagnosis.evidence.source
    x = 1e3 * loop.deflection
    x_label = f"deflection [m{source.angle}]"
    line = loop.stiffness * loop.deflection
    return [
        Chart(
            "Torque over deflection",
            "The datasheet's spring is a straight line; play, hysteresis and hardening bend it.",
            x_label,
            f"joint torque [{source.torque}]",
            _loops(x, loop, 0.0 * line, diagnosis),
        ),
        Chart(
            "Departure from the datasheet's straight line",
            "A loop is hysteresis, a step is play, a curve is hardening, a slope is stiffness.",
            x_label,
            f"torque less k_b · deflection [{source.torque}]",
            _loops(x, loop, line, diagnosis),
        ),
    ]


def _loops(x: Floats, loop: SpringLoop, line: Floats, diagnosis: Diagnosis) -> list[Curve]:
    curves = [
        Curve("measured", "measured", x, loop.measured - line, dots=True),
        Curve(BEFORE, "before", x, loop.before - line, dots=True),
        Curve(AFTER, "after", x, loop.after - line, dots=True),
    ]
    return curves if diagnosis.effects else curves[:2]
