"""Figures of the effects between the command and the current."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from tools.effects_page.bench import Floats, blocked, degrees, fourier, joint, turning
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
    draw_noise,
    draw_response,
    label,
    mosaic,
)

DT = 2e-5
K = 0.078 * 80.0  # torque per ampere of the joint, N m/A
PEAK, RESISTANCE, SUPPLY = 30.0, 0.318, 48.0


def _current(effects: dict[str, dict[str, float]], command: Floats) -> tuple[Floats, Floats]:
    """Return time [s] and the true current [A] for a commanded current [A], sampled finely."""
    record = blocked(joint(effects), command * K, DT)
    return record["t"], np.append(record["true_i"][1:], record["true_i"][-1])


def _transfer(effects: dict[str, dict[str, float]], f: float, amplitude: float) -> complex:
    """Return the first harmonic of the current per commanded current, in steady state."""
    periods, samples = max(6, int(np.ceil(0.02 * f))), round(1.0 / (f * DT))
    t = np.arange(periods * samples) * DT
    true_f = 1.0 / (samples * DT)
    command = amplitude * np.sin(2.0 * np.pi * true_f * t)
    _, current = _current(effects, command)
    last = slice(-2 * samples - 1, -1)
    return fourier(current[last], t[last], true_f) / fourier(command[last], t[last], true_f)


@plot(
    r"i(t) = i_\mathrm{cmd}(t - T)",
    "Left: the current follows the command late. Right: the dead time costs no gain, but a "
    "phase that grows in proportion to frequency, which limits the bandwidth of any loop.",
)
def command_delay() -> Figure:
    """Draw steps and phase for three dead times."""
    figure, axes = mosaic("ab")
    t = np.arange(round(0.008 / DT)) * DT
    command = np.where(t >= 1e-3, 1.0, 0.0)
    axes["a"].plot(1e3 * t, command, **NOMINAL, label="command")
    f = np.geomspace(2.0, 400.0, 14)
    fine = np.geomspace(2.0, 400.0, 100)
    for color, delay in zip(SEQUENCE, (0.5e-3, 1.5e-3, 3e-3), strict=False):
        effects = {"command_delay": {"delay": delay}}
        axes["a"].plot(1e3 * t, _current(effects, command)[1], color=color)
        values = np.array([_transfer(effects, x, 1.0) for x in f])
        axes["b"].semilogx(fine, -360.0 * fine * delay, color=color, lw=0.8)
        axes["b"].plot(f, degrees(values), **POINTS, color=color, label=f"{1e3 * delay:g} ms")
    label(axes["a"], "time [ms]", "current [A]", "step", "lower right")
    label(axes["b"], "frequency [Hz]", "phase [deg]", "points simulated, lines -360° f T")
    axes["b"].legend(loc="lower left", title="dead time T")
    return figure


@plot(
    r"\dot i = 2 \pi f_c\,(i_\mathrm{cmd} - i)",
    "Left: step responses of the current loop. Right: first-order low pass; at the bandwidth "
    "the gain is -3 dB (grey line) and the phase -45 degrees.",
)
def current_lag() -> Figure:
    """Draw steps and Bode diagram for three bandwidths."""
    figure, axes = bode()
    t = np.arange(round(0.006 / DT)) * DT
    command = np.where(t >= 5e-4, 1.0, 0.0)
    axes["a"].plot(1e3 * t, command, **NOMINAL)
    f = np.geomspace(10.0, 4000.0, 14)
    fine = np.geomspace(10.0, 4000.0, 60)
    for color, bandwidth in zip(SEQUENCE, (100.0, 300.0, 1000.0), strict=False):
        effects = {"current_lag": {"bandwidth": bandwidth}}
        axes["a"].plot(1e3 * t[::4], _current(effects, command)[1][::4], color=color)
        law = 1.0 / (1.0 + 1j * fine / bandwidth)
        values = np.array([_transfer(effects, x, 1.0) for x in f])
        draw_response(axes, (fine, law), (f, values), color, lw=0.8)
        axes["a"].plot([], [], color=color, label=f"{bandwidth:g} Hz")
    label(axes["a"], "time [ms]", "current [A]", "step", "lower right")
    axes["g"].axhline(-3.01, color=GREY, lw=0.6)
    axes["g"].set_title("points simulated, lines 1 / (1 + j f / f_c)")
    return figure


@plot(
    (
        r"v = k_t n\,\dot q_m + k_p e + k_i z, \quad \dot z = e = i_\mathrm{cmd} - "
        r"i, \quad k_p = \omega l_a, \quad k_i = \omega r, \quad \omega = 2 \pi f_c"
    ),
    "Left: in a d-q drive the current follows as a first-order lag with the bandwidth f_c, a "
    "sample late. Right: the voltage of the q axis, which is held over a sample of the "
    "controller; a controller that assumes a wrong inductance still reaches the set point.",
)
def current_control() -> Figure:
    """Draw the loop of a d-q drive: steps of the current, and what mistaken numbers do to it."""
    figure, axes = mosaic("ab")
    t = np.arange(round(0.006 / DT)) * DT
    command = np.where(t >= 5e-4, 10.0, 0.0)
    fine = t[t >= 5e-4]
    for color, bandwidth in zip(SEQUENCE, (100.0, 300.0, 750.0), strict=False):
        loop = {"current_control": {"bandwidth": bandwidth, "rate": 1e4}}
        record = blocked(joint(loop, drive="dq"), command * K, DT)
        lag = 10.0 * (1.0 - np.exp(-2.0 * np.pi * bandwidth * (fine - 5e-4)))
        axes["a"].plot(1e3 * fine, lag, color=color, lw=0.8)
        points = slice(None, None, 10)
        axes["a"].plot(1e3 * t[points], record["true_i"][points], **POINTS, color=color)
        axes["a"].plot([], [], color=color, label=f"{bandwidth:g} Hz")
    label(axes["a"], "time [ms]", "current [A]", "", "lower right")
    axes["a"].set_title("points simulated, lines 1 - exp(-2 π f_c t)")
    for color, told, words in (
        (GREY, {}, "told rightly"),
        (BLUE, {"l_a": 4e-4}, "told 2 l_a"),
        (RED, {"l_a": 1e-4}, "told l_a / 2"),
    ):
        loop = {"current_control": {"bandwidth": 300.0, "rate": 1e4, **told}}
        record = blocked(joint(loop, drive="dq"), command * K, DT)
        axes["b"].plot(1e3 * t, record["true_v"], color=color, label=words)
    label(axes["b"], "time [ms]", "voltage [V]", "the same step at 300 Hz", "lower right")
    return figure


@plot(
    r"|i| \le i_p",
    "Left: torque over commanded current, nominal and with half the peak current; simulated "
    "points on the clipped line. Right: a sine beyond the limit is flattened.",
)
def current_saturation() -> Figure:
    """Draw the static characteristic and a clipped sine."""
    figure, axes = mosaic("ab")
    ramp = np.linspace(-40.0, 40.0, 4000)
    t = np.arange(2000) * DT * 25
    sine = 28.0 * np.sin(2.0 * np.pi * 2.0 * t)
    for color, limit in ((GREY, PEAK), (BLUE, 0.5 * PEAK)):
        effects = {"current_saturation": {"i_p": limit}}
        name = f"i_p = {limit:g} A" + (" (nominal)" if limit == PEAK else "")
        current = _current(effects, ramp)[1]
        axes["a"].plot(ramp[::160], K * current[::160], **POINTS, color=color, label=name)
        axes["a"].plot(ramp, K * np.clip(ramp, -limit, limit), color=color, lw=0.8)
        axes["b"].plot(t, _current(effects, sine)[1], color=color)
    label(axes["a"], "commanded current [A]", "motor torque [N m]", "static", "upper left")
    label(axes["b"], "time [s]", "current [A]", "command 28 A sin(2π 2 Hz t)")
    return figure


@plot(
    r"|r i + k_t n\,\dot q_m| \le v_0, \quad |i| \le i_p",
    "Left: torque-speed envelope. Up to the corner speed the current limits the torque, beyond "
    "it the back-EMF leaves less and less voltage; a supply that sags moves the corner inwards "
    "and lowers the no-load speed v_0 / (k_t n). Lines are the envelope, points are simulated. "
    "Right: run-up towards the no-load speed (dotted).",
)
def voltage_saturation() -> Figure:
    """Draw the largest torque over speed with nominal and sagging supply."""
    figure, axes = mosaic("ab", width_ratios=(1.5, 1.0))
    speeds = np.linspace(-10.0, 10.0, 29)
    fine = np.linspace(-10.0, 10.0, 801)
    for color, supply in ((GREY, SUPPLY), (BLUE, 0.8 * SUPPLY)):
        effects = {"voltage_saturation": {"v_0": supply}}
        bench = joint(effects, drive="static", d_gl=200.0, d_m=0.0, d_g=0.0)
        for way in (1.0, -1.0):
            limit = np.clip((way * supply - K * fine) / RESISTANCE, -PEAK, PEAK)
            wanted = np.clip(limit, None, PEAK) if way > 0 else np.clip(limit, -PEAK, None)
            axes["a"].plot(fine, K * wanted, color=color, lw=0.9)
            for speed in speeds:
                record = turning(bench, speed, 200, way * K * PEAK)
                axes["a"].plot(speed, K * record["true_i"][-1], **POINTS, color=color)
        axes["a"].plot([], [], color=color, marker="o", ms=3.4, label=f"v_0 = {supply:g} V")
        free = joint(effects, "rigid", "static", I_l=0.2)
        record = free.simulate(np.full(120, 100.0), dt_physics=1e-4)
        axes["b"].plot(1e3 * record["t"], record["true_dq_l"], color=color)
        axes["b"].axhline(supply / K, color=color, lw=0.7, ls=":")
    label(axes["a"], "speed [rad/s]", "motor torque [N m]", "largest and least torque")
    axes["a"].legend(loc="center")
    label(axes["b"], "time [ms]", "speed [rad/s]", "run-up with 100 N m")
    return figure


@plot(
    r"|\dot i| \le \mathrm{rate}",
    "Left: a sine that asks for more than the rate becomes a triangle that lags. Right: gain "
    "of the first harmonic. It is one up to the onset f* = rate / (2 pi A), which depends on "
    "the amplitude A, and 4 f* / (pi f) once the current is a triangle.",
)
def current_rate_limit() -> Figure:
    """Draw a sine that becomes a triangle, and the gain of its first harmonic."""
    figure, axes = mosaic("ab")
    rate, amplitude = 3000.0, 20.0
    onset = rate / (2.0 * np.pi * amplitude)
    effects = {"current_rate_limit": {"rate": rate}}
    t = np.arange(round(0.06 / DT)) * DT
    command = amplitude * np.sin(2.0 * np.pi * 60.0 * t)
    axes["a"].plot(1e3 * t, command, **NOMINAL, label="command")
    axes["a"].plot(1e3 * t, _current(effects, command)[1], color=BLUE, label="current")
    label(axes["a"], "time [ms]", "current [A]", "20 A at 60 Hz, 3000 A/s", "upper right")
    axes["a"].set_ylim(-23.0, 33.0)
    for color, size in ((BLUE, 20.0), (RED, 5.0)):
        start = rate / (2.0 * np.pi * size)
        ratios = np.geomspace(0.3, 10.0, 16)
        gains = [abs(_transfer(effects, x * start, size)) for x in ratios]
        axes["b"].loglog(ratios * start, gains, **POINTS, color=color, label=f"{size:g} A")
        fine = np.geomspace(1.86, 10.0, 50)
        axes["b"].plot(fine * start, 4.0 / np.pi / fine, **LAW)
        axes["b"].plot([0.3 * start, start], [1.0, 1.0], **LAW)
    label(axes["b"], "frequency [Hz]", "gain of the first harmonic [-]", "", "lower left")
    axes["b"].set_title("lines 1 and 4 f*/(π f)")
    axes["b"].axvline(onset, color=GREY, lw=0.6)
    axes["b"].set_yticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
    axes["b"].minorticks_off()
    return figure


@plot(
    (
        r"i = \Delta \left\lfloor \frac{i_\mathrm{cmd}}{\Delta} + \frac{1}{2} "
        r"\right\rfloor, \quad \Delta = \mathrm{resolution}"
    ),
    "Left: staircase of the current over the commanded current. Right: error within half a "
    "step; its rms value is step / sqrt(12).",
)
def command_quantization() -> Figure:
    """Draw the staircase and its error."""
    figure, axes = mosaic("ab")
    step = 0.01
    ramp = np.linspace(-0.045, 0.045, 1801)
    current = _current({"command_quantization": {"resolution": step}}, ramp)[1]
    axes["a"].plot(1e3 * ramp, 1e3 * ramp, **NOMINAL, label="ideal")
    axes["a"].plot(1e3 * ramp, 1e3 * current, color=BLUE, label="10 mA")
    label(axes["a"], "commanded current [mA]", "current [mA]", "staircase", "upper left")
    axes["b"].plot(1e3 * ramp, 1e3 * (current - ramp), color=BLUE)
    for way in (-1.0, 1.0):
        axes["b"].axhline(way * 1e3 * step / np.sqrt(12.0), color=RED, lw=0.8)
    axes["b"].plot([], [], color=RED, lw=0.8, label="± step / √12 (rms)")
    label(axes["b"], "commanded current [mA]", "error [mA]", "rounded to the nearest step")
    axes["b"].set_ylim(-6.0, 9.0)
    axes["b"].legend(loc="upper right")
    return figure


@plot(
    (
        r"\tau_m = k_t n\,i_\mathrm{cmd} + w_k, \quad w_k \sim N(0, \mathrm{std}^2) "
        r"\text{ for each control step}"
    ),
    "Left: torque for a constant command. Middle: distribution with the normal law. Right: "
    "flat power spectral density of the samples, with the line 2 std^2 dt.",
)
def command_noise() -> Figure:
    """Draw noise over time, its distribution and its density."""
    figure, axes = mosaic("abc", width_ratios=(1.2, 0.9, 1.0))
    std, dt, count = 0.2, 1e-3, 60_000
    bench = joint({"command_noise": {"std": std}})
    record = blocked(bench, np.full(count, 5.0), dt, dt_physics=1e-3, seed=1)
    torque = K * record["true_i"][1:]
    t = record["t"][1:]
    axes["a"].step(1e3 * t[:60], torque[:60], color=BLUE, where="pre")
    axes["a"].axhline(5.0, **NOMINAL)
    label(axes["a"], "time [ms]", "motor torque [N m]", "command 5 N m")
    draw_noise(axes, torque - 5.0, std, dt, 1e-5)
    return figure
