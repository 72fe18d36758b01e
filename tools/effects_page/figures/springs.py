"""Figures of springs that harden or remember."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ellipk

from cjt_gym.joint.kernel.arrays import MEMORY
from cjt_gym.joint.kernel.spring_table import spring_rows, table_torque
from tools.effects_page.bench import Floats, blocked, joint
from tools.effects_page.plot import plot
from tools.effects_page.style import BLUE, GREY, LAW, NOMINAL, POINTS, RED, label, mosaic

K_B, MASS, DAMPING = 6000.0, 0.3017, 2.2036
STILL: dict[str, Any] = {"I_m": 1e7, "d_m": 0.0, "d_g": 0.0}


def bent(effects: dict[str, dict[str, Any]], bend: Floats) -> Floats:
    """Return the torque of the bar along a path of its deflection [rad], at a motor held still."""
    rate = -np.diff(np.append(bend, bend[-1]), prepend=0.0) / 1e-3
    record = joint(effects, **STILL).simulate(np.zeros(len(rate)), rate, dt_physics=1e-3)
    return record["true_tau"][1:]


def swept(k_3: float, force: float, up: bool) -> tuple[Floats, Floats]:
    """Return frequency [Hz] and amplitude [mrad] of the motor, swept slowly at blocked output."""
    low, high, span = 17.0, 32.0, 60.0
    t = np.arange(round(span / 1e-3)) * 1e-3
    slope = (high - low) / span * (1.0 if up else -1.0)
    start = low if up else high
    force_t = force * np.sin(2.0 * np.pi * (start * t + 0.5 * slope * t * t))
    record = blocked(joint({"hardening": {"k_3": k_3}}), force_t, 1e-3, dt_physics=5e-4)
    q = np.abs(record["true_q_m"])
    width = 100
    peaks = q[: len(q) // width * width].reshape(-1, width).max(axis=1)
    middle = t[: len(peaks) * width].reshape(-1, width).mean(axis=1)
    return start + slope * middle[5:-5], 1e3 * peaks[5:-5]


def steady_curve(k_3: float, force: float, amplitude: Floats) -> tuple[Floats, Floats]:
    """Return both frequencies [Hz] at which a Duffing oscillator has an amplitude [rad]."""
    k = K_B + 0.75 * k_3 * amplitude**2
    p = DAMPING**2 / MASS**2 - 2.0 * k / MASS
    q = (k * k - (force / amplitude) ** 2) / MASS**2
    root = np.sqrt(np.maximum(0.25 * p * p - q, 0.0))
    valid = 0.25 * p * p >= q
    pair = [np.where(valid, -0.5 * p + way * root, np.nan) for way in (-1.0, 1.0)]
    low, high = (np.sqrt(np.where(x > 0.0, x, np.nan)) / (2.0 * np.pi) for x in pair)
    return low, high


def backbone(k_3: float, amplitude: Floats) -> Floats:
    """Return the free frequency of a Duffing oscillator [Hz], exact."""
    hard = k_3 * amplitude**2
    m = hard / (2.0 * (K_B + hard))
    return np.asarray(np.sqrt((K_B + hard) / MASS) / (4.0 * ellipk(m)), dtype=np.float64)


@plot(
    r"\tau = k_b x + k_3 x^3 + d_{gl}\,\dot x, \quad x = q_g - q_l",
    "Left: torque over deflection. Right: forced response at blocked output; the resonance "
    "leans towards higher frequencies, and slow sweeps up and down jump at different "
    "frequencies. Line: first-harmonic balance of Duffing's oscillator; dashed: free frequency "
    "over amplitude from the elliptic integral.",
)
def hardening() -> Figure:
    """Draw torque over deflection and the bent resonance with its jumps."""
    figure, axes = mosaic("ab", 3.0, width_ratios=(0.8, 1.0))
    k_3, force = 2e6, 12.0
    bend = 0.05 * np.sin(np.linspace(0.0, 2.0 * np.pi, 2001))
    torque = bent({"hardening": {"k_3": k_3}}, bend)
    x = np.linspace(-0.05, 0.05, 201)
    axes["a"].plot(1e3 * x, K_B * x, **NOMINAL, label="k_b x")
    axes["a"].plot(1e3 * x, K_B * x + k_3 * x**3, **LAW, label="k_b x + k_3 x³")
    some = slice(500, 1500, 45)
    axes["a"].plot(1e3 * bend[some], torque[some], **POINTS, color=BLUE, label="simulated")
    label(axes["a"], "deflection [mrad]", "torque [N m]", "static", "upper left")
    amplitude = np.linspace(2e-3, 0.05, 800)
    axes["b"].plot(backbone(k_3, amplitude), 1e3 * amplitude, **NOMINAL, label="backbone")
    for curve in steady_curve(k_3, force, amplitude):
        axes["b"].plot(curve, 1e3 * amplitude, color="#222222", lw=0.9)
    for color, up in ((BLUE, True), (RED, False)):
        f, peak = swept(k_3, force, up)
        name = "sweep up" if up else "sweep down"
        axes["b"].plot(f[::7], peak[::7], **POINTS, color=color, label=name)
    axes["b"].set_xlim(17.0, 32.0)
    axes["b"].set_ylim(0.0, 50.0)
    label(axes["b"], "frequency [Hz]", "amplitude [mrad]", "12 N m at blocked output")
    axes["b"].legend(loc="upper right")
    return figure


@plot(
    r"\tau = \mathrm{scale} \cdot T(x) + d_{gl}\,\dot x, \quad x = q_g - q_l",
    "Left: a monotone cubic (PCHIP) through four measured points, which count for both "
    "directions; simulated, and the linear spring in grey. Right: its stiffness; beyond the "
    "last point it stays.",
)
def spring_table() -> Figure:
    """Draw measured points, the curve through them, and stiffness over deflection."""
    figure, axes = mosaic("ab")
    points = {"deflection": (0.0, 0.005, 0.015, 0.03), "torque": (0.0, 20.0, 90.0, 240.0)}
    bend = 0.035 * np.sin(np.linspace(0.0, 2.0 * np.pi, 2001))
    torque = bent({"spring_table": points}, bend)
    x, tau = np.array(points["deflection"]), np.array(points["torque"])
    some = slice(500, 1500, 40)
    axes["a"].plot(1e3 * bend, K_B * bend, **NOMINAL, label="k_b x")
    axes["a"].plot(1e3 * bend[some], torque[some], color=BLUE, label="simulated")
    axes["a"].plot(1e3 * np.append(-x[::-1], x), np.append(-tau[::-1], tau), **POINTS, color=RED,
                   label="points")  # fmt: skip
    label(axes["a"], "deflection [mrad]", "torque [N m]", "", "upper left")
    rows = np.concatenate(
        [np.zeros(MEMORY), spring_rows({"spring_table": points}, "points").ravel()]
    )
    fine = np.linspace(-0.035, 0.035, 801)
    stiffness = np.array([table_torque(rows, float(v))[1] for v in fine])
    axes["b"].plot(1e3 * fine, stiffness, color=BLUE)
    axes["b"].axhline(K_B, **NOMINAL)
    label(axes["b"], "deflection [mrad]", "stiffness [N m/rad]")
    return figure


def paths(*turns: float) -> Floats:
    """Return a path through these deflections [rad] in straight lines."""
    ends = [0.0, *turns]
    pieces = [np.linspace(a, b, 161)[1:] for a, b in pairwise(ends)]
    return np.concatenate([[0.0], *pieces])


@plot(
    (
        r"\text{Bouc-Wen: } \tau = k_b x + \tau_h z, \quad \delta_h\,dz = dx - "
        r"\tfrac{1}{2} (|dx| z + dx |z|)"
        "\n"
        r"\text{Maxwell slip: } \tau = k_b x + \sum_j k_j z_j, \quad dz_j = dx "
        r"\text{ while } |z_j| < z_{j,\mathrm{max}}, \text{ else } 0"
    ),
    "Torque beyond that of the linear spring over deflection: major loop (grey) and a path "
    "with an inner loop that is run through twice (blue). With Bouc-Wen the inner loop does "
    "not close and drifts; with Maxwell slip it closes, and the major loop continues "
    "as if it had not been there (wiping-out). Dashed: +- tau_h; dotted: closed form of the "
    "rising branch, which Maxwell slip follows in straight pieces.",
)
def spring_hysteresis() -> Figure:
    """Draw major and minor loops of both models."""
    figure, axes = mosaic("ab", 3.1, sharey=True)
    tau_h, delta = 1.9, 1e-3
    big, small = 4e-3, 1.4e-3
    major = paths(big, -big, big)
    minor = paths(big, -big, 0.5e-3, 0.5e-3 - small, 0.5e-3, 0.5e-3 - small, 0.5e-3, big)
    for key, elements, name in (("a", 0.0, "Bouc-Wen"), ("b", 6.0, "Maxwell slip, 6 elements")):
        law = {"tau_h": tau_h, "delta_h": delta, "elements": elements}
        effects = {"spring_hysteresis": law}
        for color, path, start in ((GREY, major, 160), (BLUE, minor, 320)):
            loop = bent(effects, path) - K_B * path
            text = "major loop" if color == GREY else "with minor loop"
            axes[key].plot(1e3 * path[start::2], loop[start::2], color=color, lw=1.1, label=text)
        rise = np.linspace(0.0, 2.0 * big, 200)
        if key == "a":
            z = np.where(rise < delta, rise / delta - 1.0, -np.expm1(1.0 - rise / delta))
        else:
            z = -2.0 * np.expm1(-0.5 * rise / delta) + np.expm1(-big / delta)
        axes[key].plot(1e3 * (rise - big), tau_h * z, **(LAW | {"ls": ":"}), label="law")
        axes[key].axhline(tau_h, **NOMINAL)
        axes[key].axhline(-tau_h, **NOMINAL)
        label(axes[key], "deflection [mrad]", "tau - k_b x [N m]", name)
        axes[key].set_ylim(-2.2, 2.8)
    axes["a"].legend(loc="upper center", ncols=3, columnspacing=1.0, handlelength=1.2)
    return figure
