"""Figures of torque that is periodic in the motor angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tools.effects_page.bench import Floats, joint
from tools.effects_page.plot import plot
from tools.effects_page.style import BLACK, BLUE, GREEN, POINTS, RED, label, mosaic

N, P, K = 80.0, 6.0, 0.078 * 80.0
SHARE = 8  # of a revolution of q_m that is turned
SAMPLES, WARM_UP, DT = 16_000, 1000, 1e-3
TORQUES = (90.0, 60.0, 30.0)  # of the motor [N m]
ROTOR = {0.0: "0", N: "80\n= n", 240.0: "240", 6.0 * N: "480\n= 6 n"}  # orders [1/rev]


def turned(effects: Mapping[str, Mapping[str, Any]], tau_m: float = 0.0) -> tuple[Floats, Floats]:
    """Return motor angle [rad] and ripple at the output [N m] of a slow, steady turn.

    The output drags the motor through a share of a revolution; the mean is taken off.
    """
    speed = 2.0 * np.pi / SHARE / (SAMPLES * DT)
    bench = joint(effects, k_b=1e6, d_gl=200.0, d_m=0.0, d_g=0.0)
    count = SAMPLES + WARM_UP
    x0 = np.array([tau_m / 1e6, tau_m / 1e6, 0.0, speed, speed, speed])
    record = bench.simulate(np.full(count, tau_m), np.full(count, speed), x0=x0, dt_physics=1e-4)
    last = slice(WARM_UP, None)
    return record["true_q_m"][last], record["true_tau"][last] - np.mean(record["true_tau"][last])


def orders(torque: Floats) -> tuple[Floats, Floats]:
    """Return periods per revolution of q_m and the amplitudes found there."""
    amplitudes = 2.0 * np.abs(np.fft.rfft(torque)) / len(torque)
    return np.arange(len(amplitudes), dtype=np.float64) * SHARE, amplitudes


def stems(axes: Axes, torque: Floats, color: str, expected: Mapping[float, float]) -> None:
    """Draw a spectrum over periods per revolution, with rings at the expected amplitudes."""
    order, amplitude = orders(torque)
    shown = amplitude > 1e-2 * amplitude.max()
    axes.vlines(order[shown], 0.0, amplitude[shown], color=color, lw=1.8)
    for place, value in expected.items():
        axes.plot(place, value, ls="none", marker="o", ms=6, mfc="none", mec=BLACK, mew=0.9)


def law(q: Floats, f: Floats, a: Floats, b: Floats) -> Floats:
    """Return the series at angles q."""
    angle = np.outer(q, f)
    return np.asarray(np.cos(angle) @ a + np.sin(angle) @ b, dtype=np.float64)


def _compare(
    effects: Mapping[str, Mapping[str, Any]],
    torques: tuple[float, ...],
    span: float,
    highest: float,
    ticks: Mapping[float, str],
) -> Figure:
    """Draw ripple over angle and its spectrum for several motor torques.

    The angle spans so much [rad], the spectrum ends at `highest` and has these ticks [1/rev].
    """
    figure, axes = mosaic("ab")
    (name, values) = next(iter(effects.items()))
    f, a, b = (np.asarray(values[key], dtype=np.float64) for key in ("f", "a", "b"))
    for color, tau_m in zip((BLUE, RED, GREEN), torques, strict=False):
        q, torque = turned(effects, tau_m)
        factor = 1.0 if name == "cogging" else tau_m
        near = q - q[0] <= span
        x = q[near] - 2.0 * np.pi / N * np.floor(q[0] * N / (2.0 * np.pi))
        fine = np.linspace(x[0], x[-1], 240)
        axes["a"].plot(1e3 * fine, factor * law(fine, f, a, b), color=BLACK, lw=0.8)
        step = max(1, int(near.sum()) // 40)
        axes["a"].plot(1e3 * x[::step], torque[near][::step], **POINTS, color=color)
        expected = dict(zip(f, abs(factor) * np.hypot(a, b), strict=True))
        stems(axes["b"], torque, color, expected)
        text = "simulated" if name == "cogging" else f"{tau_m:g} N m"
        axes["b"].plot([], [], color=color, lw=1.8, label=text)
    axes["b"].plot([], [], ls="none", marker="o", mfc="none", mec=BLACK, ms=6, label="law")
    label(axes["a"], "motor angle q_m [mrad]", "ripple [N m]", "slow, steady turn")
    label(axes["b"], "periods per revolution of q_m [1/rev]", "amplitude [N m]", "", "upper right")
    axes["b"].set_xlim(0.0, highest)
    axes["b"].set_ylim(bottom=0.0)
    axes["b"].set_xticks(list(ticks), list(ticks.values()))
    return figure


@plot(
    (
        r"\tau_c = \mathrm{scale} \cdot \sum_j \bigl(a_j \cos(f_j q_m) + b_j "
        r"\sin(f_j q_m)\bigr)"
    ),
    "Left: torque over two revolutions of the rotor; points are simulated, the line is the "
    "series. Right: spectrum over angle, with the law sqrt(a^2 + b^2) as rings: cogging stays "
    "at its orders whatever the speed and the torque.",
)
def cogging() -> Figure:
    """Draw cogging over angle and its spectrum."""
    series = {"f": (N, 6.0 * N), "a": (1.87, 0.56), "b": (-0.94, 0.37)}
    return _compare({"cogging": series}, (0.0,), 4.0 * np.pi / N, 600.0, ROTOR)


@plot(
    (
        r"\tau_c = \mathrm{scale} \cdot \tau \sum_j \bigl(a_j \cos(f_j q_m) + b_j "
        r"\sin(f_j q_m)\bigr)"
    ),
    "Left: ripple over two revolutions of the rotor at three transmitted torques. Right: "
    "spectrum; the orders stay, the amplitudes are proportional to the transmitted torque.",
)
def gear_ripple() -> Figure:
    """Draw gear ripple for several transmitted torques."""
    series = {"f": (N, 6.0 * N), "a": (0.02, 0.006), "b": (-0.01, 0.004)}
    return _compare({"gear_ripple": series}, TORQUES, 4.0 * np.pi / N, 600.0, ROTOR)


@plot(
    (
        r"\tau_c = \mathrm{scale} \cdot k_t n\,i \sum_j \bigl(a_j \cos(f_j q_m) + "
        r"b_j \sin(f_j q_m)\bigr)"
    ),
    "Left: ripple over four periods at three motor torques. Right: spectrum, with lines at "
    "multiples of six per electrical revolution that are proportional to the current.",
)
def commutation_ripple() -> Figure:
    """Draw commutation ripple for several currents."""
    order = 6.0 * P * N
    series = {"f": (order, 2.0 * order), "a": (0.02, 0.006), "b": (-0.01, 0.004)}
    ticks = {0.0: "0", order: "2880\n= 6 p n", 2.0 * order: "5760\n= 12 p n"}
    return _compare({"commutation_ripple": series}, TORQUES, 8.0 * np.pi / order, 7000.0, ticks)


@plot(
    r"\tau_c = k_t n \bigl(a \cos(p n q_m) + b \sin(p n q_m)\bigr)",
    "Left: ripple over three electrical periods, without torque (circles) and at 60 N m "
    "(squares). Right: one line at the electrical frequency p n, of amplitude "
    "k_t n sqrt(a^2 + b^2), which is the same at any torque.",
)
def current_offset() -> Figure:
    """Draw the ripple of current offsets, which does not depend on the torque."""
    figure, axes = mosaic("ab")
    a, b = 0.15, 0.09
    effects = {"current_offset": {"a": a, "b": b}}
    for color, tau_m, marker in ((RED, 60.0, "s"), (BLUE, 0.0, "o")):
        q, torque = turned(effects, tau_m)
        near = q - q[0] <= 6.0 * np.pi / (P * N)
        shift = 2.0 * np.pi / N * np.floor(q[0] * N / (2.0 * np.pi))
        x = q[near] - shift
        fine = np.linspace(x[0], x[-1], 400)
        axes["a"].plot(
            1e3 * fine,
            K * law(fine, np.array([P * N]), np.array([a]), np.array([b])),
            color=BLACK,
            lw=0.8,
        )
        style = POINTS | {"marker": marker, "ms": 6.0 if tau_m else 3.0}
        axes["a"].plot(1e3 * x[::16], torque[near][::16], **style, color=color)
        stems(axes["b"], torque, color, {P * N: K * np.hypot(a, b)})
        axes["b"].plot([], [], color=color, lw=1.8, label=f"{tau_m:g} N m")
    axes["b"].plot([], [], ls="none", marker="o", mfc="none", mec=BLACK, ms=6, label="law")
    label(axes["a"], "motor angle q_m [mrad]", "ripple [N m]", "slow, steady turn")
    label(axes["b"], "periods per revolution of q_m [1/rev]", "amplitude [N m]", "", "upper right")
    axes["b"].set_xlim(0.0, 1000.0)
    axes["b"].set_ylim(bottom=0.0)
    axes["b"].set_xticks([0, P * N, 960], ["0", "480\n= p n", "960"])
    return figure
