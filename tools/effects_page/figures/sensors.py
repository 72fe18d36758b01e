"""Figures of sensors with wrong scale or zero, noise, drift, resolution, and lost frames."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from cjt_gym.records import Record
from tools.effects_page.bench import Floats, blocked, joint, turning
from tools.effects_page.plot import plot
from tools.effects_page.style import (
    BLUE,
    GREY,
    LAW,
    NOMINAL,
    POINTS,
    RED,
    SEQUENCE,
    draw_noise,
    label,
    mosaic,
)

Effects = dict[str, dict[str, float]]


def swung(effects: Effects, samples: int = 1000, seed: int = 0) -> Record:
    """Return a damped joint at blocked output under a torque of 40 N m at 2 Hz."""
    t = np.arange(samples) * 1e-3
    return blocked(joint(effects, d_g=40.0), 40.0 * np.sin(4.0 * np.pi * t), seed=seed)


def silent(effects: Effects, samples: int, dt: float = 1e-3, seed: int = 0) -> Record:
    """Return a joint at rest, so that only its sensors show."""
    return blocked(joint(effects), np.zeros(samples), dt, dt_physics=dt, seed=seed)


def _reading(effects: Effects, law: str, gain: float, bias: float) -> Figure:
    """Draw a torque sensor's reading over the truth, and its error."""
    figure, axes = mosaic("ab")
    record = swung(effects)
    true, read = record["true_tau"], record["tau"]
    order = np.argsort(true[300:800])
    x, y = true[300:800][order][::14], read[300:800][order][::14]
    span = np.linspace(-45.0, 45.0, 3)
    axes["a"].plot(span, span, **NOMINAL, label="true")
    axes["a"].plot(span, gain * span + bias, **LAW)
    axes["a"].plot(x, y, **POINTS, color=BLUE, label="measured")
    label(axes["a"], "true joint torque [N m]", "measured [N m]", law, "upper left")
    axes["b"].plot(span, (gain - 1.0) * span + bias, **LAW)
    axes["b"].plot(x, y - x, **POINTS, color=BLUE)
    axes["b"].axhline(0.0, **NOMINAL)
    label(axes["b"], "true joint torque [N m]", "error [N m]", "measured - true")
    axes["b"].set_ylim(-6.0, 6.0)
    return figure


@plot(
    r"\tau_\mathrm{meas} = \mathrm{gain} \cdot \tau",
    "Left: reading over true torque. Right: an error that is proportional to the torque.",
)
def torque_gain() -> Figure:
    """Draw a torque sensor whose scale is wrong."""
    return _reading({"torque_gain": {"gain": 1.1}}, "gain 1.1", 1.1, 0.0)


@plot(
    r"\tau_\mathrm{meas} = \tau + \mathrm{bias}",
    "Left: reading over true torque. Right: an error that is the same at any torque.",
)
def torque_bias() -> Figure:
    """Draw a torque sensor whose zero is off."""
    return _reading({"torque_bias": {"bias": 2.0}}, "bias 2 N m", 1.0, 2.0)


@plot(
    r"y_\mathrm{meas} = \mathrm{gain} \cdot y",
    "Error of the current and of the motor angle over their true values, on straight lines "
    "through zero; speeds are scaled with their angles.",
)
def sensor_gain() -> Figure:
    """Draw the error of two channels with wrong scales."""
    figure, axes = mosaic("ab")
    record = swung({"sensor_gain": {"i": 1.05, "q_m": 0.97}})
    for key, channel, unit, scale, gain in (
        ("a", "i", "A", 1.0, 1.05),
        ("b", "q_m", "mrad", 1e3, 0.97),
    ):
        true, read = scale * record[f"true_{channel}"], scale * record[channel]
        order = np.argsort(true[300:800])[::14]
        x, y = true[300:800][order], read[300:800][order]
        axes[key].plot(x, (gain - 1.0) * x, **LAW, label=f"(gain - 1) · true, gain {gain:g}")
        axes[key].plot(x, y - x, **POINTS, color=BLUE, label="simulated")
        axes[key].axhline(0.0, **NOMINAL)
        label(axes[key], f"true {channel} [{unit}]", f"error of {channel} [{unit}]")
    axes["a"].legend(loc="upper left")
    axes["b"].legend(loc="upper right")
    axes["b"].set_ylim(top=0.42)
    axes["a"].set_ylim(top=0.55)
    return figure


@plot(
    r"y_\mathrm{meas} = y + \mathrm{bias}",
    "Current, motor angle and angle of the blocked output: each channel is shifted by its own "
    "bias. Shifted encoders shift a torque that is computed from deflection.",
)
def sensor_bias() -> Figure:
    """Draw channels whose zeros are off."""
    figure, axes = mosaic("abc", 2.5)
    record = swung({"sensor_bias": {"i": 0.8, "q_m": 1e-3, "q_l": -1e-3}})
    for key, channel, unit, scale in (
        ("a", "i", "A", 1.0),
        ("b", "q_m", "mrad", 1e3),
        ("c", "q_l", "mrad", 1e3),
    ):
        t = record["t"]
        axes[key].plot(t, scale * record[f"true_{channel}"], **NOMINAL, label="true")
        axes[key].plot(t, scale * record[channel], color=BLUE, label="measured")
        label(axes[key], "time [s]", f"{channel} [{unit}]")
    axes["c"].set_ylim(-1.5, 1.0)
    axes["c"].legend(loc="upper right")
    return figure


@plot(
    r"y_\mathrm{meas} = y + w_k, \quad w_k \sim N(0, \mathrm{std}^2)",
    "Left: torque of a joint at rest, with one standard deviation in grey. Middle: "
    "distribution with the normal law. Right: flat power spectral density, with 2 std^2 dt.",
)
def noise() -> Figure:
    """Draw noise over time, its distribution and its density."""
    figure, axes = mosaic("abc", width_ratios=(1.2, 0.9, 1.0))
    std, dt = 0.085, 1e-3
    record = silent({"noise": {"tau": std}}, 60_000, dt, seed=2)
    x = record["tau"]
    axes["a"].plot(1e3 * record["t"][:150], x[:150], color=BLUE, lw=0.8)
    axes["a"].axhspan(-std, std, color=GREY, alpha=0.25, lw=0.0)
    label(axes["a"], "time [ms]", "measured torque [N m]", "joint at rest")
    draw_noise(axes, x, std, dt, 1e-6)
    return figure


def allan(x: Floats, widths: Floats) -> Floats:
    """Return the Allan deviation of x for averages over these numbers of samples."""
    total = np.concatenate([[0.0], np.cumsum(x)])
    found = []
    for width in widths.astype(int):
        mean = (total[width:] - total[:-width]) / width
        found.append(np.sqrt(0.5 * np.mean((mean[width:] - mean[:-width]) ** 2)))
    return np.array(found)


@plot(
    (
        r"b_{k+1} = b_k + \mathrm{drift} \sqrt{dt}\,w_k, \quad y_\mathrm{meas} = y "
        r"+ b"
    ),
    "Left: zeros that walk, with the standard deviation drift sqrt(t). Right: Allan deviation; "
    "white noise falls as T^-1/2, a random walk rises as T^1/2 with drift sqrt(T / 3), and a "
    "sensor with both has its best averaging time where they meet.",
)
def drift() -> Figure:
    """Draw random walks and their Allan deviation beside that of white noise."""
    figure, axes = mosaic("ab")
    rate, std, dt = 0.05, 0.085, 1e-2
    for color, seed in zip((*SEQUENCE, GREY), range(5), strict=True):
        record = silent({"drift": {"tau": rate}}, 6000, dt, seed)
        axes["a"].plot(record["t"][::50], record["tau"][::50], color=color, lw=0.9)
    t = np.linspace(0.0, 60.0, 200)
    for way in (1.0, -1.0):
        axes["a"].plot(t, way * rate * np.sqrt(t), **LAW)
    label(axes["a"], "time [s]", "zero of the torque [N m]", "five seeds, ± drift √t")
    widths = np.unique(np.round(np.geomspace(1.0, 20_000.0, 16)))
    fine = np.geomspace(dt, 200.0, 50)
    for color, effects, name in (
        (BLUE, {"drift": {"tau": rate}}, "drift"),
        (GREY, {"noise": {"tau": std}}, "noise"),
        (RED, {"drift": {"tau": rate}, "noise": {"tau": std}}, "both"),
    ):
        x = silent(effects, 400_000, dt, 7)["tau"]
        style = POINTS | {"marker": "s" if name == "both" else "o"}
        shown = widths[3 if name == "drift" else 0 :]
        axes["b"].loglog(shown * dt, allan(x, shown), **style, color=color, label=name)
    axes["b"].plot(fine, rate * np.sqrt(fine / 3.0), **LAW)
    axes["b"].plot(fine, std * np.sqrt(dt / fine), **LAW)
    axes["b"].text(8.0, 0.025, "slope +½")
    axes["b"].text(3.0, 0.0012, "slope -½", ha="right")
    label(axes["b"], "averaging time [s]", "Allan deviation [N m]", "", "upper center")
    axes["b"].set_ylim(5e-4, 1.0)
    return figure


@plot(
    (
        r"y_\mathrm{meas} = \Delta \left\lfloor \frac{y}{\Delta} + \frac{1}{2} "
        r"\right\rfloor, \quad \Delta = \mathrm{resolution}"
    ),
    "Left: staircase of an encoder with 19 bits per turn, 2 pi / 2^19 rad. Right: in motion "
    "the error is uniform over one step; the line is the uniform density.",
)
def quantization() -> Figure:
    """Draw the staircase of an encoder and the distribution of its error."""
    figure, axes = mosaic("ab")
    step = 2.0 * np.pi / 2**19
    bench = joint({"quantization": {"q_m": step}}, d_m=0.0, d_g=0.0, I_m=1e4)
    speed = 5e-6
    x0 = np.array([-3.0 * step, -3.0 * step, 0.0, speed, speed, 0.0])
    record = blocked(bench, np.zeros(15_000), x0=x0, dt_physics=1e-3)
    true, read = 1e6 * record["true_q_m"], 1e6 * record["q_m"]
    axes["a"].plot(true[::60], true[::60], **NOMINAL, label="true")
    axes["a"].plot(true[::20], read[::20], color=BLUE, label="19 bits")
    label(axes["a"], "true motor angle [µrad]", "measured [µrad]", "staircase", "upper left")
    t = np.arange(40_000) * 1e-3
    torque = 40.0 * np.sin(13.4 * t) + 17.0 * np.sin(4.5 * t)
    record = blocked(joint({"quantization": {"q_m": step}}, d_g=40.0), torque)
    error = (record["q_m"] - record["true_q_m"]) / step
    axes["b"].hist(error, 30, density=True, color=BLUE, alpha=0.45, label="simulated")
    axes["b"].plot([-0.75, -0.5, -0.5, 0.5, 0.5, 0.75], [0, 0, 1, 1, 0, 0], **LAW)
    text = f"rms {np.std(error):.4f} step\n1/√12 = {12**-0.5:.4f}"
    axes["b"].text(0.0, 0.4, text, ha="center")
    label(axes["b"], "error / step [-]", "density [-]", "moving joint: uniform error")
    return figure


@plot(
    (
        r"q_\mathrm{meas} = q + e \sin(f q + \varphi), \quad \dot q_\mathrm{meas} = "
        r"\dot q \bigl(1 + e f \cos(f q + \varphi)\bigr)"
    ),
    "Left: error over one revolution, of the output's encoder (f = 1) and of a motor encoder "
    "whose shaft turns eight times. Right: the ripple that it causes in the speed grows with "
    "the turns of the shaft.",
)
def eccentricity() -> Figure:
    """Draw the error of encoders that run off centre, over one revolution."""
    figure, axes = mosaic("ab")
    law = {"q_l": 5e-4, "q_m": 1e-4, "phase": 0.5, "turns": 8.0}
    bench = joint({"eccentricity": law}, d_m=0.0, d_g=0.0)
    record = turning(bench, 1.0, 6284, dt_physics=1e-3)
    fine = np.linspace(0.0, 360.0, 361)
    angle = np.radians(fine)
    for color, name, size, turns in ((BLUE, "q_l", 5e-4, 1.0), (RED, "q_m", 1e-4, 8.0)):
        true = record[f"true_{name}"]
        error = 1e3 * (record[name] - true)
        axes["a"].plot(fine, 1e3 * size * np.sin(turns * angle + 0.5), **LAW)
        step = 180 if name == "q_l" else 65
        axes["a"].plot(np.degrees(true[::step]), error[::step], **POINTS, color=color, label=name)
        rate = record[f"d{name}"][1:] - record[f"true_d{name}"][1:]
        axes["b"].plot(fine, 1e3 * size * turns * np.cos(turns * angle + 0.5), **LAW)
        axes["b"].plot(np.degrees(true[1:][::step]), 1e3 * rate[::step], **POINTS, color=color)
    for key in "ab":
        axes[key].set_xticks([0, 90, 180, 270, 360])
    axes["a"].set_ylim(-0.65, 0.9)
    axes["a"].legend(loc="upper right", ncols=2)
    label(axes["a"], "angle of the joint [deg]", "error of the angle [mrad]", "e sin(f q + phase)")
    label(axes["b"], "angle of the joint [deg]", "error of the speed [mrad/s]", "at 1 rad/s")
    return figure


@plot(
    (
        r"y_{\mathrm{meas},k} = y_{\mathrm{meas},k-1} \text{ with the given "
        r"probability}"
    ),
    "Left: lost frames repeat the measurement before. Right: gaps of k frames are as frequent "
    "as the geometric distribution says.",
)
def dropout() -> Figure:
    """Draw held measurements, and how often how many frames are lost in a row."""
    figure, axes = mosaic("ab")
    p = 0.2
    record = swung({"dropout": {"probability": p}}, 100_000, 3)
    part = slice(490, 535)
    t, true, read = 1e3 * record["t"][part], record["true_tau"][part], record["tau"][part]
    lost = read != true
    axes["a"].plot(t, true, **NOMINAL, label="true")
    axes["a"].step(t, read, where="post", color=BLUE, lw=1.0, label="measured")
    axes["a"].plot(t[lost], read[lost], **POINTS, color=RED, label="lost frame")
    label(axes["a"], "time [ms]", "joint torque [N m]", f"probability {p:g}")
    axes["a"].legend(loc="lower right")
    missing = (record["tau"] != record["true_tau"]).astype(int)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing, [0]])))
    runs = edges[1::2] - edges[::2]
    length = np.arange(1, 7)
    share = [np.mean(runs == k) for k in length]
    axes["b"].semilogy(length, (1.0 - p) * p ** (length - 1.0), **LAW, label="(1 - p) pᵏ⁻¹")
    axes["b"].plot(length, share, **(POINTS | {"ms": 5.0}), color=BLUE, label="simulated")
    label(axes["b"], "frames k lost in a row [-]", "share of the gaps [-]", "", "upper right")
    return figure
