"""Figures of measurements that are late or filtered."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cjt_gym.records import Record
from tools.effects_page.bench import (
    Complexes,
    Floats,
    blocked,
    decibel,
    degrees,
    fourier,
    joint,
    multisine,
    tones,
    turning,
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

DT, PERIOD = 1e-3, 2.0
STIFF: dict[str, Any] = {"k_b": 2e4, "d_g": 60.0}
Effects = dict[str, dict[str, float]]


def shaken(effects: Effects, f: Floats) -> Record:
    """Return two periods of a joint at blocked output under a multisine."""
    t = np.arange(round(2.0 * PERIOD / DT)) * DT
    return blocked(joint(effects, **STIFF), multisine(f, t), DT)


def transfer(record: Record, output: str, source: str, f: Floats) -> Complexes:
    """Return the frequency response from one column of a record to another."""
    last = slice(len(record["t"]) // 2, None)
    t = record["t"][last]
    y, u = ([fourier(record[name][last], t, x) for x in f] for name in (output, source))
    return np.array(y) / np.array(u)


def _step(delay: Effects) -> Record:
    t = np.arange(60) * DT
    return blocked(joint(delay, **STIFF), np.where(t >= 4e-3, 20.0, 0.0))


def _late_phase(
    axes: Axes, record: Record, channel: str, f: Floats, delay: float, color: str, name: str
) -> None:
    fine = np.linspace(f[0], f[-1], 60)
    axes.plot(fine, -360.0 * fine * delay, color=color, lw=0.8)
    values = transfer(record, channel, f"true_{channel}", f)
    axes.plot(f, degrees(values), **POINTS, color=color, label=name)


@plot(
    r"\tau_\mathrm{meas}(t) = \tau(t - T)",
    "Left: torque after a step; samples lie on the true torque shifted by the delay, also by a "
    "fraction of the sample. Right: phase from true to measured torque; the gain stays one.",
)
def torque_delay() -> Figure:
    """Draw a late step response of the torque, and its phase."""
    figure, axes = mosaic("ab")
    f = tones(4.0, 200.0, 14, 0.5)
    for color, delay in zip((BLUE, RED), (1.5e-3, 4e-3), strict=True):
        effects = {"torque_delay": {"delay": delay}}
        record = _step(effects)
        axes["a"].plot(1e3 * record["t"], record["tau"], **POINTS, color=color)
        true = blocked(joint({}, **STIFF), np.where(np.arange(600) >= 40, 20.0, 0.0), 1e-4)
        t, tau = true["t"] + delay, true["true_tau"]
        axes["a"].plot(1e3 * t[t < 0.06][::4], tau[t < 0.06][::4], color=color, lw=0.8)
        if delay < 2e-3:
            axes["a"].plot(1e3 * true["t"][::4], tau[::4], **NOMINAL, label="true")
        name = f"{1e3 * delay:g} ms"
        _late_phase(axes["b"], shaken(effects, f), "tau", f, delay, color, name)
    label(axes["a"], "time [ms]", "joint torque [N m]", "step, 1 kHz sampling", "lower right")
    label(axes["b"], "frequency [Hz]", "phase [deg]", "measured per true, line -360° f T")
    axes["b"].legend(loc="lower left", title="delay T")
    return figure


@plot(
    (
        r"y_\mathrm{meas}(t) = y(t - T_y), \text{ for a velocity together with its "
        r"angle}"
    ),
    "Left: in steady rotation a late encoder reads too little by speed times delay; the "
    "difference of two that are unequally late looks like a deflection. Right: phase from true "
    "to measured angle, in proportion to frequency and each channel's delay.",
)
def channel_delay() -> Figure:
    """Draw two angles, one of which is delayed, and the phase of each channel."""
    figure, axes = mosaic("ab")
    f = tones(4.0, 200.0, 14, 0.5)
    effects = {"channel_delay": {"q_m": 0.5e-3, "q_l": 1e-3}}
    t = np.arange(round(2.0 * PERIOD / DT) + 1) * DT
    angle = multisine(f, t, 1e-4)
    bench = joint(effects, **STIFF)
    tau_m = multisine(f[::-1], t[:-1], 1.0)
    record = bench.simulate(tau_m, np.diff(angle) / DT, DT, dt_physics=1e-4)
    for color, channel, delay in ((BLUE, "q_m", 0.5e-3), (RED, "q_l", 1e-3)):
        name = f"{channel}, {1e3 * delay:g} ms"
        _late_phase(axes["b"], record, channel, f, delay, color, name)
    label(axes["b"], "frequency [Hz]", "phase [deg]", "measured per true", "lower left")
    speed = 2.0
    turn = joint(effects, d_m=0.0, d_g=0.0)
    record = turning(turn, speed, 40)
    t = 1e3 * record["t"]
    for color, channel in ((BLUE, "q_m"), (RED, "q_l")):
        error = 1e3 * (record[channel] - record[f"true_{channel}"])
        axes["a"].plot(t, error, **POINTS, color=color, label=channel)
    axes["a"].axhline(-speed * 0.5, color=BLUE, lw=0.8)
    axes["a"].axhline(-speed * 1.0, color=RED, lw=0.8)
    axes["a"].set_ylim(-2.6, 0.6)
    label(axes["a"], "time [ms]", "error of the angle [mrad]", "turning at 2 rad/s")
    axes["a"].legend(loc="upper right", ncols=2)
    return figure


@plot(
    r"y_\mathrm{meas}(t) = y(t - T) \text{ for all channels}",
    "Left: all channels are shifted by the same 2 ms. Right: command to measured torque with "
    "and without (grey) the delay; the gain is the same, the phase that a torque loop can use "
    "is not.",
)
def measurement_delay() -> Figure:
    """Draw all channels late by the same time, and the loop phase that is lost."""
    figure, axes = bode(3.1)
    effects = {"measurement_delay": {"delay": 2e-3}}
    record = _step(effects)
    t = 1e3 * record["t"]
    for color, channel, scale, name in (
        (BLUE, "tau", 1.0, "tau"),
        (RED, "q_m", 1e4, "q_m"),
        (GREY, "i", 1.0, "i"),
    ):
        axes["a"].plot(t, scale * record[f"true_{channel}"], color=color, lw=0.8, ls="--")
        axes["a"].plot(t, scale * record[channel], **POINTS, color=color, label=name)
    label(
        axes["a"],
        "time [ms]",
        "[N m], [0.1 mrad], [A]",
        "20 N m, true dashed",
        "upper right",
    )
    axes["a"].set_ylim(-1.5, 39.0)
    f = tones(4.0, 200.0, 16, 0.5)
    for color, delay in ((GREY, 0.0), (BLUE, 2e-3)):
        spec = {"measurement_delay": {"delay": delay}} if delay else {}
        values = transfer(shaken(spec, f), "tau", "tau_cmd", f)
        axes["g"].plot(f, decibel(values), color=color, marker="o", ms=3.0, lw=0.8)
        axes["p"].plot(f, degrees(values), color=color, marker="o", ms=3.0, lw=0.8)
    axes["g"].set_title("command to measured torque, 0 and 2 ms")
    return figure


@plot(
    (
        r"v_k = v_{k-1} + \left(1 - e^{-2 \pi f_c dt}\right) \left(\frac{q_k - "
        r"q_{k-1}}{dt} - v_{k-1}\right)"
    ),
    "Left: speed from an encoder of 19 bits at 1 kHz; without a filter it jumps by one step "
    "per sample. Right: gain and phase relative to an ideal derivative; points are simulated, "
    "lines are the discrete filter, half a sample of delay included.",
)
def velocity_differentiation() -> Figure:
    """Draw a differentiated encoder, and its frequency response against the true speed."""
    figure, axes = bode(3.1)
    step = 2.0 * np.pi / 2**19
    t = np.arange(400) * DT
    for color, cutoff in ((GREY, 1e4), (BLUE, 100.0), (RED, 20.0)):
        effects = {"velocity_differentiation": {"cutoff": cutoff}, "quantization": {"q_m": step}}
        bench = joint(effects, "rigid", d_m=0.0, d_g=0.0)
        record = bench.simulate(np.where(t >= 0.05, 0.03, 0.0), dt_physics=1e-4)
        shown = record["t"] < 0.3
        name = "no filter" if cutoff == 1e4 else f"{cutoff:g} Hz"
        axes["a"].plot(
            1e3 * t[shown],
            1e3 * record["dq_m"][shown],
            color=color,
            lw=0.6 if cutoff == 1e4 else 1.2,
            label=name,
        )
    axes["a"].plot(1e3 * t[shown], 1e3 * record["true_dq_m"][shown], **LAW, label="true")
    label(axes["a"], "time [ms]", "motor speed [mrad/s]", "19 bits, 1 kHz", "upper left")
    f = tones(3.0, 450.0, 18, 0.5)
    fine = np.geomspace(f[0], f[-1], 120)
    z = np.exp(-2j * np.pi * fine * DT)
    for color, cutoff in ((BLUE, 100.0), (RED, 20.0)):
        keep = np.exp(-2.0 * np.pi * cutoff * DT)
        law = (1.0 - z) / DT * (1.0 - keep) / (1.0 - keep * z) / (2j * np.pi * fine)
        record = shaken({"velocity_differentiation": {"cutoff": cutoff}}, f)
        values = transfer(record, "dq_m", "true_q_m", f) / (2j * np.pi * f)
        draw_response(axes, (fine, law), (f, values), color, lw=0.8)
    axes["g"].set_title("relative to an ideal derivative")
    return figure


@plot(
    r"y_k = y_{k-1} + \left(1 - e^{-2 \pi f_c dt}\right) (\tau_k - y_{k-1})",
    "Left: torque after a step. Right: gain and phase from true to measured torque; points are "
    "simulated, solid lines are the discrete filter, dotted the analog low pass, from which it "
    "departs towards half the sampling rate.",
)
def torque_filter() -> Figure:
    """Draw a filtered step, and the filter's frequency response."""
    figure, axes = bode(3.1)
    f = tones(3.0, 450.0, 18, 0.5)
    fine = np.geomspace(f[0], f[-1], 120)
    z = np.exp(-2j * np.pi * fine * DT)
    for color, cutoff in zip(SEQUENCE, (20.0, 100.0), strict=False):
        effects = {"torque_filter": {"cutoff": cutoff}}
        record = _step(effects)
        if color == BLUE:
            axes["a"].plot(1e3 * record["t"], record["true_tau"], **NOMINAL, label="true")
        axes["a"].plot(1e3 * record["t"], record["tau"], color=color, label=f"{cutoff:g} Hz")
        keep = np.exp(-2.0 * np.pi * cutoff * DT)
        law = (1.0 - keep) / (1.0 - keep * z)
        values = transfer(shaken(effects, f), "tau", "true_tau", f)
        draw_response(axes, (fine, law), (f, values), color, lw=0.8)
        axes["g"].plot(fine, decibel(1.0 / (1.0 + 1j * fine / cutoff)), color=color, lw=0.8, ls=":")
        axes["p"].plot(fine, degrees(1.0 / (1.0 + 1j * fine / cutoff)), color=color, lw=0.8, ls=":")
    label(axes["a"], "time [ms]", "joint torque [N m]", "step of 20 N m", "lower right")
    axes["g"].axhline(-3.01, color=GREY, lw=0.6)
    axes["g"].set_title("measured per true torque")
    return figure
