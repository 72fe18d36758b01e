"""Figure of backlash: hysteresis, describing function, impacts."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tools.effects_page.bench import Complexes, Floats, blocked, fourier, joint
from tools.effects_page.plot import plot
from tools.effects_page.style import BLUE, GREY, LAW, NOMINAL, POINTS, RED, SEQUENCE, label, mosaic

GAP, FREQUENCY, DT = 2e-3, 2.0, 1e-3
DRY = {"coulomb": {"d_cm": 3.0, "d_cg": 0.0, "dq_0": 0.0}}
UNDAMPED: dict[str, Any] = {"d_m": 0.0, "d_g": 0.0}
LIGHT: dict[str, Any] = UNDAMPED | {"I_m": 0.005, "I_g": 0.005, "k_b": 1e6, "d_gl": 20.0}


def dragged(amplitude: float) -> tuple[Floats, Floats, Floats]:
    """Return time, output angle and motor angle over the last of three periods.

    The output moves as a sine; friction holds the motor while the play is open.
    """
    period = round(1.0 / (FREQUENCY * DT))
    t = np.arange(3 * period + 1) * DT
    angle = amplitude * np.sin(2.0 * np.pi * FREQUENCY * t)
    bench = joint({"backlash": {"gap": GAP}, **DRY}, **LIGHT)
    record = bench.simulate(np.zeros(3 * period), np.diff(angle) / DT, dt_physics=1e-4)
    last = slice(2 * period, None)
    return record["t"][last], record["true_q_l"][last], record["true_q_m"][last]


def describing_function(ratio: Floats) -> Complexes:
    """Return the describing function of friction-controlled backlash.

    Args:
        ratio: Amplitude per gap, > 1/2.
    """
    x = 1.0 - 1.0 / ratio
    real = (0.5 * np.pi + np.arcsin(x) + x * np.sqrt(1.0 - x * x)) / np.pi
    return np.asarray(real - 1j * (1.0 - x * x) / np.pi, dtype=np.complex128)


@plot(
    (
        r"\tau = k \max\left(|x - \mathrm{offset}| - \tfrac{1}{2} \mathrm{gap}, "
        r"0\right) \operatorname{sign}(x - \mathrm{offset}) + d\,\dot x \text{ in "
        r"contact, never pulling}"
        "\n"
        r"\tau = 0 \text{ within the gap}, \quad x = q_g - q_l \quad (q_m - q_g "
        r"\text{ if the gear is compliant})"
    ),
    "Top left: output moved as a sine, motor held by friction while the play is open; the loop "
    "is as wide as the gap at any amplitude. Right: gain and phase of its first harmonic over "
    "amplitude per gap, simulated on the describing function of friction-controlled backlash; "
    "below half a gap nothing is transmitted, and the lag is largest close to it. Bottom left: "
    "phase portrait of a free motor at blocked output; it crosses the gap (grey) at constant "
    "speed and rebounds at its sides, for ever if the contact is elastic.",
)
def backlash() -> Figure:
    """Draw the loop, the describing function and the phase portrait with impacts."""
    figure, axes = mosaic("ab;cd", 5.0)
    for color, ratio in zip(SEQUENCE, (0.75, 1.5, 3.0), strict=False):
        _, q_l, q_m = dragged(ratio * GAP)
        axes["a"].plot(1e3 * q_l[::3], 1e3 * q_m[::3], color=color, label=f"A / gap = {ratio:g}")
    axes["a"].plot([-6.0, 6.0], [-6.0, 6.0], **NOMINAL)
    label(axes["a"], "output angle [mrad]", "motor angle [mrad]", "motor dragged through 2 mrad")
    axes["a"].legend(loc="upper left")
    ratios = np.concatenate([np.linspace(0.55, 1.2, 6), np.geomspace(1.4, 10.0, 7)])
    fine = np.geomspace(0.505, 10.0, 70)
    law = describing_function(fine)
    values = np.array([_harmonic(x) for x in ratios])
    for key, of, unit in (("b", np.abs, "gain [-]"), ("d", np.angle, "phase [deg]")):
        scale = 1.0 if key == "b" else 180.0 / np.pi
        axes[key].semilogx(fine, scale * of(law), **LAW, label="describing function")
        axes[key].plot(ratios, scale * of(values), **POINTS, color=BLUE, label="simulated")
        axes[key].set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
        axes[key].minorticks_off()
        label(axes[key], "amplitude / gap [-]", unit)
    axes["b"].set_title("first harmonic of the motor angle")
    axes["b"].legend(loc="lower right")
    for color, d_gl, name in ((GREY, 0.0, "elastic"), (RED, 8.0, "d_gl = 8 N m s/rad")):
        bench = joint({"backlash": {"gap": GAP}}, d_gl=d_gl, **UNDAMPED)
        x0 = np.array([0.0, 0.0, 0.0, 0.2, 0.2, 0.0])
        record = blocked(bench, np.zeros(2200), 1e-4, x0=x0, dt_physics=2e-5)
        count = 660 if d_gl == 0.0 else 2200
        q, dq = 1e3 * record["true_q_m"][:count], record["true_dq_m"][:count]
        axes["c"].plot(q[::8], dq[::8], color=color, label=name, lw=1.1)
    axes["c"].axvspan(-500.0 * GAP, 500.0 * GAP, color=GREY, alpha=0.2, lw=0.0)
    label(axes["c"], "deflection [mrad]", "its rate [rad/s]", "impacts at blocked output")
    axes["c"].legend(loc="upper center")
    axes["c"].set_ylim(-0.23, 0.42)
    return figure


def _harmonic(ratio: float) -> complex:
    t, q_l, q_m = dragged(ratio * GAP)
    return fourier(q_m, t, FREQUENCY) / fourier(q_l, t, FREQUENCY)
