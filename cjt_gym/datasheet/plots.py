"""The plots of a sheet as functions that draw into given Matplotlib axes.

Each takes the axes and one joint's parameters, or several joints' to lay over each other; most
joints come from `cjt_gym.joint.load_joint_file(name).parameters`, or from `acting(file)` with the
effects of a file. The style of the sheets is `cjt_gym.datasheet.drawing.STYLE`,
for `matplotlib.rc_context`.

Example:
    >>> from matplotlib.figure import Figure
    >>> from cjt_gym.datasheet import plots
    >>> from cjt_gym.joint import load_joint_file
    >>> axes = Figure().subplots()
    >>> plots.efficiency_curves(axes, load_joint_file("orange_80_6000").parameters)
    >>> axes.get_ylabel()
    'efficiency [%]'
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from cjt_gym.characteristics import (
    CHARACTERISTICS,
    best_efficiency,
    best_point,
    characteristic,
    efficiency,
    friction,
    holding_map,
    impedance_range,
    resonance,
    speed_at_torque,
    steady_temperature,
    time_to_critical,
    torque_limits,
)
from cjt_gym.characteristics.motor import usable_power
from cjt_gym.datasheet.drawing import BLUE, COLOURS, GREEN, GREY, INK, ORANGE, RED
from cjt_gym.datasheet.drawing import legend as place_legend
from cjt_gym.datasheet.notation import drawn, number
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint import JointParameters

Joints = JointParameters | Sequence[JointParameters]
POINT: Any = {"ls": "none", "marker": "o", "ms": 4.0, "zorder": 5, "clip_on": False}
LONGEST = 1e4  # time that is drawn as for ever: hours [s]
COPPER_MELTS = 1084.0  # beyond which a temperature is none of a winding [degC]
SHARES = (0.1, 0.25, 0.5, 0.75)
"""Speeds of efficiency curves, over the zero-torque speed."""
POINTS = 120  # of each side of a map, which is drawn 8 cm wide


def _several(joints: Joints) -> Sequence[JointParameters]:
    return [joints] if isinstance(joints, JointParameters) else joints


def _label(p: JointParameters, symbol: str, quantity: str) -> str:
    return f"{quantity} [{p.unit(symbol)}]"


def _over_frequency(axes: Axes, f: Any, label: str) -> None:
    axes.set(xlim=(f[0], f[-1]), xlabel="frequency [Hz]", ylabel=label)


def _torque_and_speed(axes: Axes, p: JointParameters, torque: float, speed: float) -> None:
    axes.set(xlim=(0.0, torque), xlabel=_label(p, "d_cm", "motor torque at the link"))
    axes.set(ylim=(0.0, speed), ylabel=_label(p, "dq_p", "speed"))


def torque_speed(axes: Axes, joints: Joints) -> None:
    """Draw the torque-speed diagram: regions, power hyperbolas, friction."""
    joints = _several(joints)
    for p, colour in zip(joints, COLOURS, strict=False):
        peak, stall = _largest(p), characteristic(p, "t_stall")
        tau = np.linspace(0.0, min(peak, stall), 400)
        line = np.minimum(speed_at_torque(p, tau), p.get("dq_p", math.inf))
        edge = [*tau, tau[-1]], [*line, 0.0]
        if len(joints) > 1:
            axes.plot(*edge, color=colour, label=drawn(p.name))
            axes.plot(_known(p, "t_r"), _known(p, "dq_r"), color=colour, **POINT)
            continue
        axes.fill_between(tau, line, color=BLUE, alpha=0.12, lw=0.0, label="peak")
        held = tau <= _known(p, "t_r")
        if held.any():
            axes.fill_between(
                tau[held], line[held], color=BLUE, alpha=0.35, lw=0.0, label="continuous"
            )
        axes.plot(*edge, color=BLUE)
        _one_diagram(axes, p)
    _finish_diagram(axes, joints)


def _known(p: JointParameters, name: str, otherwise: float = math.nan) -> float:
    """Return a characteristic, or another number where the joint file does not allow it."""
    value = CHARACTERISTICS[name].value(p)
    return otherwise if value is None else value


def _largest(p: JointParameters) -> float:
    """Return the peak torque, or that of the line at rest where there is no peak current [N m]."""
    return _known(p, "t_p", characteristic(p, "t_stall"))


def _one_diagram(axes: Axes, p: JointParameters) -> None:
    peak, top = _largest(p), characteristic(p, "dq_0")
    tau = np.linspace(0.01 * peak, 1.15 * peak, 400)
    for name, style, text in (("p_pm", "--", "peak power"), ("p_cm", ":", "rated power")):
        power = _known(p, name)
        if math.isnan(power):
            continue
        power = usable_power(p) if name == "p_pm" else power
        shown = power / tau <= 1.12 * top
        label = f"{text}, {number(power, 3)} W"
        axes.plot(tau[shown], (power / tau)[shown], color=GREY, ls=style, lw=0.9, label=label)
    speed = np.linspace(0.0, characteristic(p, "dq_0"), 50)
    axes.plot(friction(p, speed), speed, color=RED, lw=1.0, label="friction")
    axes.plot(_known(p, "t_r"), _known(p, "dq_r"), color=INK, **POINT)
    axes.plot(_known(p, "t_NL"), _known(p, "dq_NL"), color=RED, **POINT)
    axes.plot(peak, min(float(speed_at_torque(p, peak)), p.get("dq_p", math.inf)), color=BLUE,
              **POINT)  # fmt: skip


def _finish_diagram(axes: Axes, joints: Sequence[JointParameters]) -> None:
    torque, speed = max(map(_largest, joints)), max(characteristic(p, "dq_0") for p in joints)
    _torque_and_speed(axes, joints[0], 1.15 * torque, 1.12 * speed)
    below = {"loc": "lower right", "bbox_to_anchor": (0.94, 0.08)}
    place_legend(axes, **below if len(joints) == 1 else {})


def efficiency_map(axes: Axes, p: JointParameters, top: float | None = None) -> Any:
    """Draw the efficiency over the whole plane of torque and speed; return what a colorbar takes.

    Args:
        axes: Where.
        p: Parameters.
        top: Upper end of the colours [%]; the largest efficiency, rounded up, if absent.
    """
    top = highest_shade([p]) if top is None else top
    step = 5.0 if top <= 50.0 else 10.0
    shades = mpl.colormaps["YlGnBu"].resampled(round(top / step))
    tau = np.linspace(0.0, characteristic(p, "t_p"), 240)
    speed = np.linspace(0.0, min(characteristic(p, "dq_0"), p.get("dq_p", math.inf)), 240)
    values = 100.0 * efficiency(p, tau[None, :], speed[:, None])
    levels = np.arange(0.0, top + 1.0, step)
    shown = axes.contourf(tau, speed, values, levels=levels, cmap=shades)
    axes.contour(tau, speed, values, levels=levels[1:], colors="white", linewidths=0.4)
    axes.plot(*best_point(p), color=RED, label=f"{100.0 * best_efficiency(p):.0f} %", **POINT)
    axes.plot(characteristic(p, "t_r"), characteristic(p, "dq_r"), color=INK, **POINT)
    _torque_and_speed(axes, p, 1.03 * characteristic(p, "t_p"), 1.05 * characteristic(p, "dq_0"))
    place_legend(axes, loc="lower right", handletextpad=0.2)
    return shown


def highest_shade(joints: Joints) -> float:
    """Return the upper end of the colours that suits the efficiencies of joints [%]."""
    return max(10.0, 10.0 * math.ceil(10.0 * max(best_efficiency(p) for p in _several(joints))))


def efficiency_curves(
    axes: Axes, p: JointParameters, speeds: Sequence[float] | None = None
) -> None:
    """Draw the efficiency over the torque at chosen speeds, and at full voltage.

    Args:
        axes: Where.
        p: Parameters.
        speeds: Speeds > 0 [rad/s]; a tenth to three quarters of the zero-torque speed if absent.

    Raises:
        ConfigurationError: A speed is not positive and finite.
    """
    given = [share * characteristic(p, "dq_0") for share in SHARES] if speeds is None else speeds
    if not all(math.isfinite(dq) and dq > 0.0 for dq in given):
        raise ConfigurationError(
            f"speeds must be finite and > 0 {p.unit('dq_p')}, got {list(given)}."
        )
    tau = np.linspace(0.0, characteristic(p, "t_p"), 600)
    shades = mpl.colormaps["viridis"](np.linspace(0.1, 0.85, len(given)))
    for dq, colour in zip(given, shades, strict=True):
        values = 100.0 * efficiency(p, tau, np.array(dq))
        axes.plot(tau, values, color=colour, label=f"{number(dq, 3)} {p.unit('dq_p')}")
    full = np.maximum(speed_at_torque(p, tau), 0.0)
    axes.plot(tau, 100.0 * efficiency(p, tau, full), color=INK, ls="--", lw=0.9,
              label="full voltage")  # fmt: skip
    axes.axvline(characteristic(p, "t_r"), color=GREY, lw=0.7, ls=":")
    axes.set_xlim(0.0, characteristic(p, "t_p"))
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel=_label(p, "d_cm", "motor torque at the link"), ylabel="efficiency [%]")
    place_legend(axes, loc="best")


def holding(axes: Axes, p: JointParameters, winding: float | None = None) -> Any:
    """Draw how long joint torques can be held, over amplitude and frequency, output locked.

    White lines bound what can be held for ever; what is left blank current, voltage or speed do not
    allow. Return what a colorbar takes.

    Args:
        axes: Where.
        p: Parameters.
        winding: Temperature at the start [degC]; ambient if absent.
    """
    f = np.geomspace(0.05 * resonance(p), 10.0 * resonance(p), POINTS)
    limits = torque_limits(p, f)
    tau = np.geomspace(0.02 * characteristic(p, "t_r"), 1.1 * float(limits.peak.max()), POINTS)
    times = holding_map(p, tau, f, winding)
    longest = min(10.0 ** math.ceil(math.log10(p.T_thm)), LONGEST)
    least = times[np.isfinite(times)].min(initial=longest)
    floor = max(10.0 ** math.floor(math.log10(max(least, 1e-3))), 1e-3)
    levels = np.geomspace(floor, longest, 2 * round(math.log10(longest / floor)) + 1)
    shown = axes.contourf(f, tau, np.minimum(times, longest).T, levels=levels, cmap="YlGnBu",
                          norm=LogNorm(floor, longest), extend="min")  # fmt: skip
    axes.loglog(f, limits.lasting, color="white", lw=1.2)
    axes.loglog(f, limits.peak, color=INK, lw=1.0, label="possible at all")
    axes.axvline(resonance(p), color=GREY, lw=0.7, ls=":")
    axes.set_ylim(tau[0], tau[-1])
    _over_frequency(axes, f, _label(p, "d_cm", "joint torque, amplitude"))
    place_legend(axes, loc="lower left")
    return shown


def time_held(axes: Axes, joints: Joints) -> None:
    """Draw how long constant torques can be held: from ambient, and a single joint from warm."""
    joints = _several(joints)
    for p, colour in zip(joints, COLOURS, strict=False):
        tau = np.linspace(0.0, characteristic(p, "t_p"), 80)
        starts: list[tuple[float | None, str, str]] = [(None, "-", "from ambient")]
        if len(joints) == 1:
            warm = 0.5 * (p.Tmp_ANom + p.Tmp_WMax)
            starts.append((warm, "--", f"from {warm:.0f} °C"))
        for winding, style, text in starts:
            held = np.array([time_to_critical(p, float(x), winding) for x in tau])
            held[held > LONGEST] = np.nan
            label = text if len(joints) == 1 else drawn(p.name)
            axes.semilogy(tau, held, color=colour, ls=style, label=label)
    _mark_rated(axes, joints)
    axes.set_ylabel("time held [s]")
    axes.set_ylim(top=LONGEST)
    place_legend(axes, loc="upper right")


def final_temperature(axes: Axes, joints: Joints) -> None:
    """Draw where the winding's temperature ends at constant torques."""
    joints = _several(joints)
    for p, colour in zip(joints, COLOURS, strict=False):
        tau = np.linspace(0.0, characteristic(p, "t_p"), 400)
        ends = steady_temperature(p, tau)
        axes.plot(tau, np.where(ends < COPPER_MELTS, ends, np.nan), color=colour)
        axes.axhline(p.Tmp_WMax, color=RED, lw=0.8, ls="--")
    _mark_rated(axes, joints)
    axes.set(ylim=(0.0, 500.0), ylabel="ends at [°C]")


def _mark_rated(axes: Axes, joints: Sequence[JointParameters]) -> None:
    for p, colour in zip(joints, COLOURS, strict=False):
        shade = INK if len(joints) == 1 else colour
        axes.axvline(characteristic(p, "t_r"), color=shade, lw=0.7, ls=":")
    axes.set_xlim(0.0, max(characteristic(p, "t_p") for p in joints))
    axes.set_xlabel(_label(joints[0], "d_cm", "motor torque at the link, rms"))


def torque_bandwidth(axes: Axes, joints: Joints) -> None:
    """Draw the torque that is available over frequency with locked output."""
    joints = _several(joints)
    centre = [resonance(p) for p in joints]
    f = np.geomspace(0.05 * min(centre), 10.0 * max(centre), 500)
    for p, colour in zip(joints, COLOURS, strict=False):
        limits = torque_limits(p, f)
        if len(joints) > 1:
            axes.loglog(f, limits.peak, color=colour, label=drawn(p.name))
            axes.loglog(f, limits.lasting, color=colour, ls="--", lw=0.8)
            continue
        axes.fill_between(f, limits.peak, 1e-9, color=BLUE, alpha=0.12, lw=0.0)
        axes.fill_between(f, limits.lasting, 1e-9, color=BLUE, alpha=0.3, lw=0.0)
        for values, line, text in (
            (limits.current, BLUE, "peak current"),
            (limits.continuous, GREEN, "rated current"),
            (limits.voltage, ORANGE, "voltage"),
            (limits.speed, GREY, "peak speed"),
        ):
            if np.isfinite(values).all():
                axes.loglog(f, values, color=line, lw=1.0, label=text)
    peak = max(characteristic(p, "t_p") for p in joints)
    rated = min(characteristic(p, "t_r") for p in joints)
    axes.set_ylim(0.02 * rated, 10.0 * peak)
    _over_frequency(axes, f, _label(joints[0], "d_cm", "joint torque, amplitude"))
    place_legend(axes, loc="lower left")


def torque_with_load(axes: Axes, p: JointParameters) -> Any:
    """Draw the peak torque over frequency for free loads; return what a colorbar takes."""
    inertia = p.I_m + p.get("I_g", 0.0)
    f = np.geomspace(0.02 * resonance(p), 10.0 * resonance(p), 600)
    ratios = 10.0 ** np.arange(-2.0, 2.01, 0.5)
    shades, norm = mpl.colormaps["viridis"], LogNorm(ratios[0], ratios[-1])
    for ratio in ratios:
        limits = torque_limits(p, f, inertia * ratio)
        axes.loglog(f, limits.peak, color=shades(norm(ratio)), lw=1.0)
    axes.loglog(f, torque_limits(p, f).peak, color=INK, lw=1.0, ls="--", label="locked output")
    peak = characteristic(p, "t_p")
    axes.set_ylim(0.01 * peak, 10.0 * peak)
    _over_frequency(axes, f, _label(p, "d_cm", "joint torque, amplitude"))
    place_legend(axes, loc="upper left")
    return mpl.cm.ScalarMappable(norm, shades)


def usual_motion(p: JointParameters) -> float:
    """Return a motion [rad] whose torque in a held bar is a fifth of the peak, one digit."""
    return float(f"{0.2 * characteristic(p, 't_p') / p.k_b:.0e}")


def impedance(axes: Axes, joints: Joints) -> None:
    """Draw the impedances that the joints can show while the output moves by `usual_motion`."""
    joints = _several(joints)
    motion = min(usual_motion(p) for p in joints)
    centre = [resonance(p) for p in joints]
    f = np.geomspace(0.02 * min(centre), 10.0 * max(centre), 600)
    for p, colour in zip(joints, COLOURS, strict=False):
        width = impedance_range(p, f, motion)
        floor = 1e-3 * float(np.abs(width.own).min())
        if len(joints) == 1:
            axes.fill_between(f, width.high, np.maximum(width.low, floor), color=BLUE,
                              alpha=0.15, lw=0.0, label="with the motor")  # fmt: skip
            axes.loglog(f, np.abs(width.own), color=INK, label="motor without current")
            axes.loglog(f, np.abs(width.held), color=ORANGE, ls="--", label="motor held")
        else:
            axes.loglog(f, width.high, color=colour, label=drawn(p.name))
            axes.loglog(f, np.where(width.low > 0.0, width.low, np.nan), color=colour, ls="--",
                        lw=0.8)  # fmt: skip
        axes.set_ylim(bottom=0.1 * float(np.abs(width.own).min()))
    _over_frequency(axes, f, _label(joints[0], "d_gl", "impedance of the output"))
    place_legend(axes)
