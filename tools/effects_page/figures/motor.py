"""Figures of deviations from the nominal motor: torque constant, offset, inertia, damping."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tools.effects_page.bench import blocked, joint, model_response, response, tones
from tools.effects_page.plot import plot
from tools.effects_page.style import (
    BLACK,
    BLUE,
    GREY,
    POINTS,
    bode,
    draw_response,
    label,
    mosaic,
)

K_T, N = 0.078, 80.0
K_B, I_M, I_G = 6000.0, 0.23, 0.0717
_SHIFT = "Points are simulated, lines are the linear model with that value."


@plot(
    r"\tau_m = k_t' n\,i, \quad i_\mathrm{cmd} = \frac{\tau_\mathrm{cmd}}{k_t n}",
    "Left: steady torque over current at blocked output; the slope is k_t n. Right: a "
    "commanded torque is missed by a constant share, whatever its size (grey: nominal).",
)
def torque_constant() -> Figure:
    """Draw torque over current at blocked output, and its response."""
    figure, axes = mosaic("ab")
    currents = np.linspace(-20.0, 20.0, 17)
    t = np.arange(1000) * 1e-3
    tau_m = np.where((t > 0.1) & (t < 0.6), 50.0, 0.0)
    for color, factor in ((GREY, 1.0), (BLUE, 0.9)):
        effects = {"torque_constant": {"k_t": factor * K_T}}
        bench = joint(effects, d_g=40.0)
        steady = [
            blocked(bench, np.full(600, i * K_T * N))["true_tau"][-100:].mean() for i in currents
        ]
        axes["a"].plot(currents, factor * K_T * N * currents, color=color, lw=0.9)
        name = f"k_t = {factor * K_T:.4g} N m/A" + (" (nominal)" if factor == 1.0 else "")
        axes["a"].plot(currents, steady, **POINTS, color=color, label=name)
        axes["b"].plot(t, blocked(bench, tau_m)["true_tau"], color=color)
    axes["b"].plot(t, tau_m, color=BLACK, lw=0.8, ls=":", label="command")
    label(axes["a"], "current [A]", "torque at the output [N m]", "blocked output", "upper left")
    label(axes["b"], "time [s]", "torque at the output [N m]", "50 N m commanded", "upper right")
    return figure


@plot(
    r"\tau_m = k_t n\,i + \mathrm{torque}",
    "Left: characteristic shifted by the offset. Right: a free joint without command creeps to "
    "the speed torque / d; lines are the exponential law.",
)
def torque_offset() -> Figure:
    """Draw the shifted characteristic and the speed that it causes."""
    figure, axes = mosaic("ab")
    offset, commands = 0.94, np.linspace(-4.0, 4.0, 17)
    for color, torque in ((GREY, 0.0), (BLUE, offset)):
        effects = {"torque_offset": {"torque": torque}}
        bench = joint(effects, d_g=40.0)
        steady = [blocked(bench, np.full(600, x))["true_tau"][-100:].mean() for x in commands]
        axes["a"].plot(commands, commands + torque, color=color, lw=0.9)
        axes["a"].plot(commands, steady, **POINTS, color=color, label=f"{torque:g} N m")
        free = joint(effects, "rigid", I_l=0.2)
        record = free.simulate(np.zeros(2000), dt_physics=1e-4)
        axes["b"].plot(record["t"][::80], record["true_dq_m"][::80], **POINTS, color=color)
        damping = 2.2036
        law = torque / damping * -np.expm1(-damping / (I_M + I_G + 0.2) * record["t"])
        axes["b"].plot(record["t"], law, color=color, lw=0.9)
    label(axes["a"], "commanded torque [N m]", "torque at the output [N m]", "blocked output")
    axes["a"].legend(loc="upper left", title="offset")
    label(axes["b"], "time [s]", "speed [rad/s]", "free joint, no command")
    return figure


def _two_responses(
    effects: dict[str, dict[str, float]], **real: Any
) -> tuple[Figure, dict[str, Axes]]:
    """Draw a Bode diagram from motor torque to joint torque, nominal and with an effect."""
    figure, axes = bode()
    fine = np.geomspace(2.0, 120.0, 250)
    f = tones(2.0, 120.0, 22, 0.25)
    for color, of, parameters in ((GREY, {}, {}), (BLUE, effects, real)):
        values = response(joint(of), f, period=4.0)
        law = model_response(joint({}, **parameters), fine)
        draw_response(axes, (fine, law), (f, values), color)
    axes["g"].set_title("motor torque to joint torque")
    axes["p"].set_yticks([-180, -90, 0])
    return figure, axes


@plot(
    r"(I_m' + I_g)\,\ddot q + (d_m + d_g)\,\dot q + k_b q = \tau_m",
    "Left: a heavier rotor runs up more slowly. Right: it lowers the resonance and the "
    f"roll-off of torque transmission, with the same static gain. {_SHIFT}",
)
def inertia() -> Figure:
    """Draw run-up and resonance with more inertia."""
    more = 1.2 * I_M
    figure, axes = _two_responses({"inertia": {"I_m": more}}, I_m=more)
    for color, value in ((GREY, I_M), (BLUE, more)):
        effects = {"inertia": {"I_m": value}}
        free = joint(effects, "rigid", d_g=0.0, d_m=0.0)
        record = free.simulate(np.full(500, 2.0), dt_physics=1e-4)
        t, name = record["t"], f"{value:.3g} kg m²" + (" (nominal)" if value == I_M else "")
        axes["a"].plot(t[::30], record["true_dq_m"][::30], **POINTS, color=color, label=name)
        axes["a"].plot(t, 2.0 / (value + I_G + 1e-4) * t, color=color, lw=0.9)
    label(axes["a"], "time [s]", "speed [rad/s]", "run-up with 2 N m", "upper left")
    return figure


@plot(
    r"D' = \operatorname{diag}(d_m', d_g', d_l')",
    "Left: ringing after release and the envelope exp(-d t / (2 I)). Right: damping lowers the "
    f"peak and hardly moves it. {_SHIFT}",
)
def damping() -> Figure:
    """Draw ringing and resonance with more damping."""
    real: dict[str, Any] = {"d_m": 3.7, "d_g": 2.2}
    figure, axes = _two_responses({"damping": {"d_m": 3.7}}, **real)
    mass = I_M + I_G
    for color, effects, total in (
        (GREY, {}, 2.2036),
        (BLUE, {"damping": {"d_m": 3.7}}, 5.9),
    ):
        bench = joint(effects)
        record = blocked(bench, np.zeros(500), x0=np.array([0.01, 0.01, 0, 0, 0, 0]))
        t = record["t"]
        axes["a"].plot(t, record["true_tau"], color=color, lw=0.9)
        for way in (1.0, -1.0):
            some = t[::10]
            law = way * 60.0 * np.exp(-0.5 * total / mass * some)
            axes["a"].plot(some, law, color=color, lw=0.7)
    label(axes["a"], "time [s]", "joint torque [N m]", "blocked output, released at 60 N m")
    axes["a"].plot([], [], color=GREY, label="d_m + d_g = 2.2 N m s/rad")
    axes["a"].plot([], [], color=BLUE, label="5.9 N m s/rad")
    axes["a"].legend(loc="upper right")
    return figure


@plot(
    r"\tau = k_b' (q_g - q_l) + d_{gl} (\dot q_g - \dot q_l)",
    "Left: slope of torque over deflection. Right: the resonance moves with the square root of "
    f"the stiffness. A sensor that multiplies deflection by k_b would be wrong by the same "
    f"share. {_SHIFT}",
)
def stiffness() -> Figure:
    """Draw torque over deflection and the resonance of a softer bar."""
    soft = 0.85 * K_B
    figure, axes = _two_responses({"stiffness": {"k_b": soft}}, k_b=soft)
    torques = np.linspace(-60.0, 60.0, 13)
    for color, k in ((GREY, K_B), (BLUE, soft)):
        bench = joint({"stiffness": {"k_b": k}}, d_g=40.0)
        records = [blocked(bench, np.full(600, x)) for x in torques]
        bends = np.array([r["true_q_g"][-1] - r["true_q_l"][-1] for r in records])
        name = f"{k:g} N m/rad" + (" (nominal)" if k == K_B else "")
        taus = [r["true_tau"][-1] for r in records]
        axes["a"].plot(1e3 * bends, taus, **POINTS, color=color, label=name)
        axes["a"].plot(1e3 * bends, k * bends, color=color, lw=0.9)
    label(axes["a"], "deflection of the bar [mrad]", "joint torque [N m]", "static", "upper left")
    return figure


@plot(
    r"\tau_\mathrm{gear} = k_g' (q_m - q_g) + d_{mg} (\dot q_m - \dot q_g)",
    "Left: wind-up of the gear. Right: two resonances, here with little damping d_mg; the "
    f"second, of the gear's inertia between its springs, moves most. {_SHIFT}",
)
def gear_stiffness() -> Figure:
    """Draw the wind-up of the gear and the second resonance of a softer one."""
    figure, axes = bode()
    fine, f = np.geomspace(5.0, 200.0, 250), tones(5.0, 200.0, 26, 0.5)
    torques = np.linspace(-60.0, 60.0, 13)
    for color, k in ((GREY, 16000.0), (BLUE, 0.7 * 16000.0)):
        effects = {"gear_stiffness": {"k_g": k}}
        bench = joint(effects, "output_fixed", d_g=40.0)
        records = [blocked(bench, np.full(600, x)) for x in torques]
        twist = np.array([r["true_q_m"][-1] - r["true_q_g"][-1] for r in records])
        taus = [r["true_tau"][-1] for r in records]
        name = f"{k:g} N m/rad" + (" (nominal)" if k == 16000.0 else "")
        axes["a"].plot(1e3 * twist, taus, **POINTS, color=color, label=name)
        axes["a"].plot(1e3 * twist, k * twist, color=color, lw=0.9)
        values = response(joint(effects, "output_fixed", d_mg=5.0), f, dt=2e-4)
        law = model_response(joint({}, "output_fixed", k_g=k, d_mg=5.0), fine)
        draw_response(axes, (fine, law), (f, values), color)
    label(axes["a"], "twist of the gear [mrad]", "joint torque [N m]", "static", "upper left")
    axes["g"].set_title("motor torque to joint torque")
    return figure
