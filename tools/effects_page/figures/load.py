"""Figures of what the joint is attached to."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from scipy.special import ellipk

from tools.effects_page.bench import (
    Floats,
    density,
    fourier,
    joint,
    model_response,
    response,
    tones,
)
from tools.effects_page.plot import plot
from tools.effects_page.style import (
    BLUE,
    GREY,
    LAW,
    NOMINAL,
    POINTS,
    RED,
    SEQUENCE,
    bode,
    draw_response,
    label,
    mosaic,
)

FREE = "rigid_gearbox"
MASS = 0.2  # of the load, kg m^2
BARE: dict[str, Any] = {"I_m": 0.05, "I_g": 0.05, "I_l": 0.1, "d_m": 0.0, "d_g": 0.0, "d_l": 0.0}


@plot(
    r"I_l' \ddot q_l + d_l \dot q_l = \tau + \tau_l",
    "Left: run-up with the load. Right: a heavier load takes a larger share of the motor's "
    "torque and lowers the resonance of motor against load. Points are simulated, lines are "
    "the linear model with that value.",
)
def load_inertia() -> Figure:
    """Draw run-up and resonance with more inertia of the load."""
    figure, axes = bode()
    fine, f = np.geomspace(3.0, 150.0, 250), tones(3.0, 150.0, 22, 0.25)
    for color, inertia in ((GREY, MASS), (BLUE, 2.0 * MASS)):
        effects = {"load_inertia": {"I_l": inertia}}
        name = f"{inertia:g} kg m²" + (" (nominal)" if inertia == MASS else "")
        free = joint(effects, "rigid", I_l=MASS, d_m=0.0, d_g=0.0)
        record = free.simulate(np.full(500, 2.0), dt_physics=1e-4)
        t = record["t"]
        axes["a"].plot(t[::30], record["true_dq_l"][::30], **POINTS, color=color, label=name)
        axes["a"].plot(t[[0, -1]], 2.0 / (0.3017 + inertia) * t[[0, -1]], color=color, lw=0.9)
        values = response(joint(effects, FREE, I_l=MASS, d_g=6.0), f, period=4.0)
        law = model_response(joint({}, FREE, I_l=inertia, d_g=6.0), fine)
        draw_response(axes, (fine, law), (f, values), color)
    label(axes["a"], "time [s]", "speed [rad/s]", "run-up with 2 N m", "upper left")
    axes["g"].set_title("motor torque to joint torque")
    return figure


@plot(
    r"\tau_g = -\mathrm{torque} \cdot \sin(q_l - \mathrm{angle})",
    "Left: torque that carries the load through a slow turn, for two angles at which it hangs. "
    "Right: period of the free pendulum, on the elliptic integral; it grows with amplitude.",
)
def gravity() -> Figure:
    """Draw torque over angle, and the period of the pendulum over its amplitude."""
    figure, axes = mosaic("ab")
    weight = 9.4
    for color, angle in ((BLUE, 0.0), (RED, 0.5)):
        effects = {"gravity": {"torque": weight, "angle": angle}}
        arm = joint(effects, FREE, **(BARE | {"I_m": 1e5, "d_gl": 30.0}))
        speed = 0.5
        x0 = np.array([-np.pi, -np.pi, -np.pi, speed, speed, speed])
        record = arm.simulate(np.zeros(12_567), x0=x0, dt_physics=1e-3)
        q = np.degrees(record["true_q_l"])
        fine = np.linspace(-180.0, 180.0, 121)
        law = weight * np.sin(np.radians(fine) - angle)
        axes["a"].plot(fine, law, color=color, lw=0.9)
        axes["a"].plot(
            q[300::350], record["true_tau"][300::350], **POINTS, color=color, label=f"{angle:g} rad"
        )
    axes["a"].set_xticks([-180, -90, 0, 90, 180])
    label(axes["a"], "angle of the load [deg]", "joint torque [N m]", "turned slowly")
    axes["a"].legend(loc="upper left", title="angle")
    amplitudes = np.radians(np.linspace(10.0, 170.0, 17))
    effects = {"gravity": {"torque": weight}}
    periods = np.array([_period(effects, a) for a in amplitudes])
    small = 2.0 * np.pi * np.sqrt(MASS / weight)
    fine = np.radians(np.linspace(1.0, 174.0, 150))
    law = 4.0 * np.sqrt(MASS / weight) * ellipk(np.sin(0.5 * fine) ** 2)
    axes["b"].plot(np.degrees(fine), law, **LAW, label="elliptic integral")
    axes["b"].plot(np.degrees(amplitudes), periods, **POINTS, color=BLUE, label="simulated")
    axes["b"].axhline(small, **NOMINAL, label="small amplitude")
    axes["b"].set_xticks([0, 45, 90, 135, 180])
    label(axes["b"], "amplitude [deg]", "period [s]", "free pendulum", "upper left")
    return figure


def _period(effects: dict[str, dict[str, float]], amplitude: float) -> float:
    x0 = np.array([amplitude, amplitude, amplitude, 0.0, 0.0, 0.0])
    record = joint(effects, "rigid", **BARE).simulate(np.zeros(4000), x0=x0, dt_physics=1e-4)
    q, t = record["true_q_l"], record["t"]
    at = np.flatnonzero((q[:-1] > 0.0) & (q[1:] <= 0.0))[:2]
    crossing = t[at] + 1e-3 * q[at] / (q[at] - q[at + 1])
    return float(crossing[1] - crossing[0])


def bounced(damping: float, speed: float) -> tuple[Floats, Floats, float]:
    """Return penetration, contact torque and coefficient of restitution of one impact."""
    contact = {"stiffness": 1870.0, "exponent": 1.5, "damping": damping, "position": 0.0}
    bench = joint({"contact": contact}, "rigid", **BARE)
    x0 = np.array([0.0, 0.0, 0.0, speed, speed, speed])
    record = bench.simulate(np.zeros(6000), dt=1e-4, x0=x0, dt_physics=1e-5)
    q, dq = record["true_q_l"], record["true_dq_l"]
    torque = -MASS * np.diff(dq) / 1e-4
    inside = np.flatnonzero(q < 0.0)
    end = int(inside[0]) if len(inside) else len(torque)
    return 0.5 * (q[:end] + q[1 : end + 1]), torque[:end], float(-dq[-1] / speed)


def restitution(damping: float, speed: float) -> float:
    """Return the exact coefficient of restitution of the law of Hunt and Crossley.

    The work over penetration and over the way back are equal:
    v / c - ln(1 + c v) / c^2 is the same for v = speed and v = -e speed.
    """

    def stored(v: float) -> float:
        return float(v / damping - np.log1p(damping * v) / damping**2)

    top = min(speed, (1.0 - 1e-12) / damping)
    out = brentq(lambda v: stored(-v) - stored(speed), 1e-9, top)
    return float(out) / speed


@plot(
    (
        r"\tau_c = -k\,x^e \max(0, 1 + \mathrm{damping} \cdot \dot x), \quad x = "
        r"\max(0, q_l - \mathrm{position})"
    ),
    "Left: torque over penetration in one impact; the loop's area is lost. Middle: a load that "
    "is pushed against the contact (grey) bounces. Right: coefficient of restitution; points "
    "are simulated, lines are the exact solution of the law. It falls with speed, and is one "
    "without damping.",
)
def contact() -> Figure:
    """Draw loops of penetration, bounces, and the coefficient of restitution."""
    figure, axes = mosaic("abc", 2.8)
    for color, damping in zip(SEQUENCE, (0.0, 0.5, 2.0), strict=False):
        x, torque, _ = bounced(damping, 1.0)
        axes["a"].plot(1e3 * x[::12], torque[::12], color=color, label=f"{damping:g} s/rad")
        law = {"stiffness": 1870.0, "exponent": 1.5, "damping": damping, "position": 0.0}
        ball = joint({"contact": law}, "rigid", **BARE)
        start = np.array([-0.1, -0.1, -0.1, 0.0, 0.0, 0.0])
        record = ball.simulate(np.full(2000, 2.0), x0=start, dt_physics=1e-4)
        axes["b"].plot(record["t"][::8], 1e3 * record["true_q_l"][::8], color=color, lw=1.0)
        if damping:
            fine = np.linspace(0.05, 3.0, 50)
            axes["c"].plot(fine, [restitution(damping, v) for v in fine], **LAW)
        speeds = np.linspace(0.15, 3.0, 12)
        found = [bounced(damping, v)[2] for v in speeds]
        axes["c"].plot(speeds, found, **POINTS, color=color)
    axes["b"].set_ylim(-105.0, 50.0)
    axes["b"].axhspan(0.0, 60.0, color=GREY, alpha=0.2, lw=0.0)
    axes["a"].legend(loc="upper left", title="damping")
    axes["c"].set_ylim(0.0, 1.08)
    axes["a"].set_ylim(top=14.0)
    label(axes["a"], "penetration [mrad]", "contact torque [N m]", "impact at 1 rad/s")
    label(axes["b"], "time [s]", "angle of the load [mrad]", "pushed with 2 N m")
    label(axes["c"], "speed of impact [rad/s]", "restitution [-]", "speed after / before")
    return figure


@plot(
    (
        r"q_l = q_{l,\mathrm{given}} + \mathrm{amplitude} \cdot \sin(2 \pi f t), "
        r"\quad f = \mathrm{frequency}"
    ),
    "Left: moved output and the torque that the joint passes on. Right: mechanical impedance "
    "that the output feels, from motions at many frequencies, with the linear model; below the "
    "resonance it is the motor's damping and inertia, above it the bar alone (dashed: k_b).",
)
def load_motion() -> Figure:
    """Draw a moved output and the impedance that it feels."""
    figure, axes = bode()
    law = {"amplitude": 0.01, "frequency": 5.0}
    bench = joint({"load_motion": law}, d_g=10.0)
    record = bench.simulate(np.zeros(1000), dt_physics=1e-4)
    last = slice(600, None)
    t = 1e3 * (record["t"][last] - 0.6)
    axes["a"].plot(t, 1e3 * record["true_q_l"][last], color=BLUE, label="angle")
    axes["a"].plot(t, record["true_tau"][last], color=RED, label="torque")
    axes["a"].set_ylim(-13.0, 19.0)
    label(
        axes["a"],
        "time [ms]",
        "angle [mrad], torque [N m]",
        "5 Hz, motor without current",
    )
    axes["a"].legend(loc="upper right", ncols=2, columnspacing=1.0)
    f = np.array([1.0, 2.0, 4.0, 6.25, 10.0, 12.5, 16.0, 20.0, 25.0, 40.0, 50.0, 80.0, 100.0])
    values = []
    for x in f:
        spec = {"load_motion": {"amplitude": 1e-3, "frequency": float(x)}}
        record = joint(spec, d_g=10.0).simulate(np.zeros(16_000), dt=2.5e-4, dt_physics=5e-5)
        part = slice(8000, None)
        time = record["t"][part]
        torque = fourier(record["true_tau"][part], time, x)
        values.append(torque / fourier(record["true_q_l"][part], time, x))
    fine = np.geomspace(1.0, 100.0, 200)
    s = 2j * np.pi * fine
    passive = 0.3017 * s * s + 10.0036 * s
    impedance = -6000.0 * passive / (passive + 6000.0)
    draw_response(axes, (fine, -impedance), (f, -np.array(values)), BLUE, **LAW)
    axes["g"].set_title("resisting torque per angle, 0 dB = 1 N m/rad")
    axes["g"].axhline(20.0 * np.log10(6000.0), **NOMINAL)
    return figure


@plot(
    (
        r"\dot \tau_v = -2 \pi \cdot \mathrm{bandwidth} \cdot \tau_v + \text{white "
        r"noise}"
        "\n"
        r"\text{tremor: white noise through a resonance at } "
        r"\mathrm{tremor\_frequency} \text{ with 5 \% damping}"
    ),
    "Left: torque of a person, with the standard deviation of its voluntary part in grey. "
    "Right: power spectral density; a low pass for the voluntary torque and a narrow band of "
    "tremor (dashed), and their sum.",
)
def human_torque() -> Figure:
    """Draw a person's torque over time and its spectrum."""
    figure, axes = mosaic("ab", width_ratios=(1.2, 1.0))
    std, bandwidth, tremor, f_t, dt = 3.7, 1.0, 0.4, 9.0, 2e-3
    law = {"std": std, "bandwidth": bandwidth, "tremor": tremor, "tremor_frequency": f_t}
    held = BARE | {"I_m": 1e7, "I_l": 1e-4, "d_l": 5.0, "k_b": 6000.0}
    bench = joint({"human_torque": law}, FREE, **held)
    record = bench.simulate(np.zeros(500_000), dt=dt, dt_physics=dt, seed=3)
    torque = -record["true_tau"][1:]
    part = slice(2000, 5000)
    axes["a"].plot((record["t"][part] - 4.0)[::6], torque[part][::6], color=BLUE, lw=0.8)
    axes["a"].axhspan(-std, std, color=GREY, alpha=0.25, lw=0.0)
    label(axes["a"], "time [s]", "torque on the load [N m]", "voluntary torque and tremor")
    f, power = density(torque, dt, 5000)
    z = np.exp(-2j * np.pi * f * dt)
    keep = np.exp(-2.0 * np.pi * bandwidth * dt)
    slow = 2.0 * dt * std**2 * (1.0 - keep**2) / np.abs(1.0 - keep * z) ** 2
    decay = np.exp(-0.05 * 2.0 * np.pi * f_t * dt)
    turn = decay * np.exp(2j * np.pi * f_t * dt)
    band = np.abs(1.0 - turn * z) ** -2.0 + np.abs(1.0 - np.conj(turn) * z) ** -2.0
    fast = dt * tremor**2 * (1.0 - decay**2) * band
    some = np.unique(np.round(np.geomspace(1.0, len(f) - 1.0, 90)).astype(int))
    shown = (f[some] < 40.0) & (f[some] > 0.15)
    some = some[shown]
    near = (f > 0.15) & (f < 40.0)
    axes["b"].loglog(f[some], power[some], **POINTS, color=BLUE, label="simulated")
    thin = np.unique(np.round(np.geomspace(1.0, near.sum() - 1.0, 200)).astype(int))
    for values, style in ((slow, NOMINAL), (fast, NOMINAL), (slow + fast, LAW)):
        axes["b"].plot(f[near][thin], values[near][thin], **style)
    axes["b"].set_ylim(1e-4, 20.0)
    label(axes["b"], "frequency [Hz]", "density [N² m²/Hz]", "tremor at 9 Hz", "lower left")
    return figure
