"""The figures of a sheet: of one joint in full, of several laid over each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm

from cjt_gym.characteristics import (
    CHARACTERISTICS,
    best_efficiency,
    best_point,
    characteristic,
    efficiency,
    friction,
    impedance_range,
    resonance,
    speed_at_torque,
    steady_temperature,
    time_to_critical,
    torque_limits,
)
from cjt_gym.datasheet.drawing import BLUE, COLOURS, GREEN, GREY, HALF, INK, ORANGE, RED, canvas
from cjt_gym.datasheet.drawing import legend as place_legend
from cjt_gym.datasheet.notation import drawn, number
from cjt_gym.joint import JointParameters

Joints = Sequence[JointParameters]
POINT: Any = {"ls": "none", "marker": "o", "ms": 4.0, "zorder": 5, "clip_on": False}
LONGEST = 1e4
COPPER_MELTS = 1084.0


def _label(p: JointParameters, symbol: str, quantity: str) -> str:
    return f"{quantity} [{p.unit(symbol)}]"


def torque_speed(joints: Joints) -> str:
    """Return the torque-speed diagram: regions, power hyperbolas, friction."""
    with canvas() as (figure, written):
        axes = figure.subplots()
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
        return written()


def _known(p: JointParameters, name: str, otherwise: float = math.nan) -> float:
    """Return a characteristic, or another number where the joint file does not allow it."""
    value = CHARACTERISTICS[name].value(p)
    return otherwise if value is None else value


def _largest(p: JointParameters) -> float:
    """Return the peak torque, or that of the line at rest where there is no peak current [N m]."""
    return _known(p, "t_p", characteristic(p, "t_stall"))


def _one_diagram(axes: Any, p: JointParameters) -> None:
    """Add hyperbolas of power, friction and points of one joint."""
    peak, top = _largest(p), characteristic(p, "dq_0")
    tau = np.linspace(0.01 * peak, 1.15 * peak, 400)
    for name, style, text in (("p_pm", "--", "peak power"), ("p_cm", ":", "rated power")):
        power = _known(p, name)
        if math.isnan(power):
            continue
        shown = power / tau <= 1.12 * top
        label = f"{text}, {number(power, 3)} W"
        axes.plot(tau[shown], (power / tau)[shown], color=GREY, ls=style, lw=0.9, label=label)
    speed = np.linspace(0.0, characteristic(p, "dq_0"), 50)
    axes.plot(friction(p, speed), speed, color=RED, lw=1.0, label="friction")
    axes.plot(_known(p, "t_r"), _known(p, "dq_r"), color=INK, **POINT)
    axes.plot(_known(p, "t_NL"), _known(p, "dq_NL"), color=RED, **POINT)
    axes.plot(peak, min(float(speed_at_torque(p, peak)), p.get("dq_p", math.inf)), color=BLUE,
              **POINT)  # fmt: skip


def _finish_diagram(axes: Any, joints: Joints) -> None:
    axes.set_xlim(0.0, 1.15 * max(_largest(p) for p in joints))
    axes.set_ylim(0.0, 1.12 * max(characteristic(p, "dq_0") for p in joints))
    axes.set_xlabel(_label(joints[0], "d_cm", "motor torque at the link"))
    axes.set_ylabel(_label(joints[0], "dq_p", "speed"))
    below = {"loc": "lower right", "bbox_to_anchor": (0.94, 0.08)}
    place_legend(axes, **below if len(joints) == 1 else {})


def efficiency_map(joints: Joints) -> str:
    """Return the efficiency over the whole plane, one map per joint."""
    columns = min(len(joints), 3)
    rows = -(-len(joints) // columns)
    width = HALF if len(joints) == 1 else 2.0 * HALF
    with canvas(width, 2.55 if len(joints) == 1 else 2.0 * rows + 0.3) as (figure, written):
        grid = figure.subplots(rows, columns, squeeze=False)
        top = max(10.0, 10.0 * math.ceil(10.0 * max(best_efficiency(p) for p in joints)))
        step = 5.0 if top <= 50.0 else 10.0
        shades = mpl.colormaps["YlGnBu"].resampled(round(top / step))
        shown = None
        for axes, p in zip(grid.ravel(), joints, strict=False):
            tau = np.linspace(0.0, characteristic(p, "t_p"), 240)
            speed = np.linspace(0.0, min(characteristic(p, "dq_0"), p.get("dq_p", math.inf)), 240)
            values = 100.0 * efficiency(p, tau[None, :], speed[:, None])
            levels = np.arange(0.0, top + 1.0, step)
            shown = axes.contourf(tau, speed, values, levels=levels, cmap=shades)
            axes.contour(tau, speed, values, levels=levels[1:], colors="white", linewidths=0.4)
            best = best_point(p)
            label = f"{100.0 * best_efficiency(p):.0f} %"
            axes.plot(*best, color=RED, label=label, **POINT)
            axes.plot(characteristic(p, "t_r"), characteristic(p, "dq_r"), color=INK, **POINT)
            axes.set_xlabel(_label(p, "d_cm", "motor torque at the link"))
            axes.set_title(drawn(p.name.replace("_", " ")) if len(joints) > 1 else "")
            axes.set_xlim(0.0, 1.03 * characteristic(p, "t_p"))
            axes.set_ylim(0.0, 1.05 * characteristic(p, "dq_0"))
            place_legend(axes, loc="lower right", handletextpad=0.2)
        for axes in grid[:, 0]:
            axes.set_ylabel(_label(joints[0], "dq_p", "speed"))
        for axes in grid.ravel()[len(joints) :]:
            axes.set_visible(False)
        assert shown is not None
        figure.colorbar(shown, ax=grid, label="efficiency [%]", aspect=25, pad=0.02)
        return written()


def heat(joints: Joints) -> str:
    """Return how long torques can be held, and where temperatures end."""
    with canvas() as (figure, written):
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1.0))
        for p, colour in zip(joints, COLOURS, strict=False):
            peak = characteristic(p, "t_p")
            tau = np.linspace(0.0, peak, 80)
            starts = [(None, "-", "from ambient")]
            if len(joints) == 1:
                warm = 0.5 * (p.Tmp_ANom + p.Tmp_WMax)
                starts.append((warm, "--", f"from {warm:.0f} °C"))  # type: ignore[arg-type]
            for winding, style, text in starts:
                held = np.array([time_to_critical(p, float(x), winding) for x in tau])
                held[held > LONGEST] = np.nan
                label = text if len(joints) == 1 else drawn(p.name)
                upper.semilogy(tau, held, color=colour, ls=style, label=label)
            fine = np.linspace(0.0, peak, 400)
            ends = steady_temperature(p, fine)
            lower.plot(fine, np.where(ends < COPPER_MELTS, ends, np.nan), color=colour)
            lower.axhline(p.Tmp_WMax, color=RED, lw=0.8, ls="--")
            for axes in (upper, lower):
                rated = characteristic(p, "t_r")
                axes.axvline(rated, color=INK if len(joints) == 1 else colour, lw=0.7, ls=":")
        upper.set_ylabel("time held [s]")
        upper.set_ylim(top=LONGEST)
        lower.set_ylim(0.0, 500.0)
        lower.set_ylabel("ends at [°C]")
        lower.set_xlim(0.0, max(characteristic(p, "t_p") for p in joints))
        lower.set_xlabel(_label(joints[0], "d_cm", "motor torque at the link, rms"))
        place_legend(upper, loc="upper right")
        return written()


def torque_bandwidth(joints: Joints) -> str:
    """Return the torque that is available over frequency with locked output."""
    with canvas() as (figure, written):
        axes = figure.subplots()
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
        axes.set_xlim(f[0], f[-1])
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(_label(joints[0], "d_cm", "joint torque, amplitude"))
        place_legend(axes, loc="lower left")
        return written()


def torque_with_load(joints: Joints) -> str:
    """Return the peak torque of one joint over frequency for free loads of several inertias."""
    p = joints[0]
    inertia = p.I_m + p.get("I_g", 0.0)
    with canvas() as (figure, written):
        axes = figure.subplots()
        f = np.geomspace(0.02 * resonance(p), 10.0 * resonance(p), 600)
        ratios = 10.0 ** np.arange(-2.0, 2.01, 0.5)
        shades, norm = mpl.colormaps["viridis"], LogNorm(ratios[0], ratios[-1])
        for ratio in ratios:
            limits = torque_limits(p, f, inertia * ratio)
            axes.loglog(f, limits.peak, color=shades(norm(ratio)), lw=1.0)
        axes.loglog(f, torque_limits(p, f).peak, color=INK, lw=1.0, ls="--", label="locked output")
        peak = characteristic(p, "t_p")
        axes.set_ylim(0.01 * peak, 10.0 * peak)
        axes.set_xlim(f[0], f[-1])
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(_label(p, "d_cm", "joint torque, amplitude"))
        scale = mpl.cm.ScalarMappable(norm, shades)
        figure.colorbar(scale, ax=axes, label="load inertia / $(I_m + I_g)$", aspect=25, pad=0.02)
        place_legend(axes, loc="upper left")
        return written()


def usual_motion(p: JointParameters) -> float:
    """Return a motion [rad] whose torque in a held bar is a fifth of the peak, one digit."""
    return float(f"{0.2 * characteristic(p, 't_p') / p.k_b:.0e}")


def impedance(joints: Joints, motion: float) -> str:
    """Return the impedances that the joints can show while the output moves."""
    with canvas() as (figure, written):
        axes = figure.subplots()
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
        axes.set_xlim(f[0], f[-1])
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(_label(joints[0], "d_gl", "impedance of the output"))
        place_legend(axes)
        return written()
