"""Figures of friction."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tools.effects_page.bench import Floats, blocked, drag, joint, turning
from tools.effects_page.plot import plot
from tools.effects_page.style import (
    BLUE,
    GREY,
    LAW,
    NOMINAL,
    POINTS,
    RED,
    SEQUENCE,
    label,
    mosaic,
)

K_B = 6000.0

HOLLOW = POINTS | {"mfc": "white", "mew": 0.9}
LIGHT: dict[str, Any] = {"I_m": 0.01, "I_g": 0.01, "k_b": 1e6, "d_m": 0.0, "d_g": 0.0, "d_gl": 20.0}


def _map(effects: dict[str, dict[str, float]], speeds: Floats) -> Floats:
    """Return the friction at these speeds, measured at the output that drags the motor."""
    return np.array([-drag(effects, v) for v in speeds])


@plot(
    (
        r"\tau_f = d_c \tanh\frac{\dot q}{\dot q_0}, \quad \text{or } d_c "
        r"\operatorname{sign}(\dot q) \text{ with } \dot q_0 = 0 \text{ (set-valued "
        r"at rest)}"
    ),
    "Left: friction-velocity map, smoothed and sharp; points are measured at an output that "
    "drags the motor, lines are the law. Right: Coulomb friction takes 4 d_c off the torque's "
    "amplitude in every period, so the envelope is straight, and the oscillation stops inside "
    "the band |tau| <= d_c (grey), where friction holds.",
)
def coulomb() -> Figure:
    """Draw the friction-velocity map and the linear decay of free oscillations."""
    figure, axes = mosaic("ab")
    level, speeds = 4.0, np.linspace(-10e-3, 10e-3, 21)
    fine = np.linspace(-10e-3, 10e-3, 401)
    for color, dq_0 in ((RED, 0.0), (BLUE, 0.002)):
        effects = {"coulomb": {"d_cm": level, "d_cg": 0.0, "dq_0": dq_0}}
        moving = speeds[np.abs(speeds) > 1e-9]
        axes["a"].plot(1e3 * moving, _map(effects, moving), **POINTS, color=color)
        law = level * (np.tanh(fine / dq_0) if dq_0 else np.sign(fine))
        axes["a"].plot(1e3 * fine, law, color=color, lw=0.9, label=f"dq_0 = {1e3 * dq_0:g} mrad/s")
    label(axes["a"], "speed [mrad/s]", "friction [N m]", "", "upper left")
    effects = {"coulomb": {"d_cm": level, "d_cg": 0.0, "dq_0": 0.0}}
    bench = joint(effects, d_m=0.0, d_g=0.0)
    record = blocked(bench, np.zeros(450), x0=np.array([0.0165, 0.0165, 0, 0, 0, 0]))
    t, period = record["t"], 2.0 * np.pi * np.sqrt(0.3017 / K_B)
    axes["b"].plot(1e3 * t, record["true_tau"], color=BLUE)
    end = (99.0 - level) / (4.0 * level) * period
    for way in (1.0, -1.0):
        axes["b"].plot([0.0, 1e3 * end], [way * 99.0, way * level], **LAW)
    axes["b"].axhspan(-level, level, color=GREY, alpha=0.3, lw=0.0)
    label(axes["b"], "time [ms]", "joint torque [N m]", "free oscillation, dq_0 = 0")
    return figure


@plot(
    (
        r"\tau_f = d_c \tanh\frac{\dot q}{\dot q_0} \text{ for } \dot q \ge 0, "
        r"\quad d_{c,n} \tanh\frac{\dot q}{\dot q_0} \text{ for } \dot q < 0"
    ),
    "Left: map with unequal levels. Right: torque over angle of a slow oscillation; the loop "
    "is a rectangle, and its middle (dotted) is off zero, like a torque offset that is only "
    "there in motion.",
)
def coulomb_asym() -> Figure:
    """Draw the map and the loops of a slow oscillation."""
    figure, axes = mosaic("ab")
    speeds = np.linspace(-0.05, 0.05, 20)
    t = np.arange(4000) * 1e-3
    angle = 0.02 * np.sin(2.0 * np.pi * 0.5 * np.append(t, t[-1] + 1e-3))
    for color, up, down in ((GREY, 3.0, 3.0), (BLUE, 3.0, 4.5)):
        effects = {"coulomb_asym": {"d_cm": up, "d_cm_n": down, "d_cg": 0.0, "d_cg_n": 0.0}}
        axes["a"].plot(speeds, _map(effects, speeds), **POINTS, color=color)
        fine = np.linspace(-0.05, 0.05, 401)
        law = np.where(fine > 0, up, down) * np.tanh(fine / 0.002)
        axes["a"].plot(fine, law, color=color, lw=0.9)
        record = joint(effects, **LIGHT).simulate(
            np.zeros(len(t)), np.diff(angle) / 1e-3, dt_physics=1e-4
        )
        last = slice(2000, None)
        axes["b"].plot(
            1e3 * record["true_q_l"][last], -record["true_tau"][last], color=color, lw=1.1
        )
        axes["b"].axhline(0.5 * (up - down), color=color, lw=0.7, ls=":")
        axes["a"].plot([], [], color=color, label=f"+{up:g} / -{down:g} N m")
    label(axes["a"], "speed [rad/s]", "friction [N m]", "", "upper left")
    label(axes["b"], "angle [mrad]", "friction [N m]", "oscillation at 0.5 Hz")
    return figure


@plot(
    (
        r"\tau_f = d\,\dot q \text{ for } \dot q \ge 0, \quad d_n\,\dot q \text{ "
        r"for } \dot q < 0"
    ),
    "Left: map with a kink at zero. Right: under a torque that alternates, the free joint "
    "reaches different speeds (dashed: tau / d and tau / d_n) at different rates.",
)
def viscous_asym() -> Figure:
    """Draw the map and the run-up in both directions."""
    figure, axes = mosaic("ab")
    speeds, up, down = np.linspace(-2.0, 2.0, 17), 2.2, 5.9
    for color, extra in ((GREY, 0.0), (BLUE, down - up)):
        effects = {"viscous_asym": {"d_m_n": 0.0036 + extra}}
        bench = joint(effects, d_gl=200.0)
        taus = [-turning(bench, v, 600)["true_tau"][-100:].mean() for v in speeds]
        name = "2.2 / 2.2 N m s/rad" if extra == 0.0 else "2.2 / 5.9 N m s/rad"
        axes["a"].plot(speeds, taus, **POINTS, color=color, label=name)
        law = np.where(speeds > 0, up + 0.0036, up + 0.0036 + extra) * speeds
        axes["a"].plot(speeds, law, color=color, lw=0.9)
        t = np.arange(4000) * 1e-3
        push = 4.0 * np.sign(np.sin(2.0 * np.pi * 0.5 * t + 1e-9))
        record = joint(effects, "rigid", I_l=0.2).simulate(push, dt_physics=1e-4)
        axes["b"].plot(t, record["true_dq_m"], color=color)
    axes["b"].axhline(4.0 / 2.2036, **NOMINAL)
    axes["b"].axhline(-4.0 / 5.9, **NOMINAL)
    label(axes["a"], "speed [rad/s]", "friction [N m]", "", "upper left")
    label(axes["b"], "time [s]", "speed [rad/s]", "free joint under ±4 N m")
    return figure


@plot(
    (
        r"\tau_f = \left(d_c + d_s e^{-(\dot q / v_s)^2}\right) \tanh\frac{\dot "
        r"q}{\dot q_0}"
    ),
    "Left: Stribeck curve with the joint's viscous damping; friction falls from the breakaway "
    "level before viscous damping takes over. Right: the falling branch causes stick-slip when "
    "a soft spring drags the motor slowly (saw-teeth up to the breakaway level), and none at "
    "higher speed.",
)
def stribeck() -> Figure:
    """Draw the Stribeck curve and stick-slip behind a spring."""
    figure, axes = mosaic("ab")
    c, s, v_s, d = 3.0, 2.5, 0.05, 2.2
    law = {"d_cm": c, "d_sm": s, "v_s": v_s, "dq_0": 0.0}
    speeds = np.concatenate([np.linspace(0.004, 0.12, 13), np.linspace(0.16, 0.5, 7)])
    speeds = np.concatenate([-speeds[::-1], speeds])
    fine = np.linspace(-0.5, 0.5, 1001)
    curve = np.sign(fine) * (c + s * np.exp(-((fine / v_s) ** 2))) + d * fine
    points = [-drag({"stribeck": law}, v) + d * v for v in speeds]
    axes["a"].plot(fine, curve, **LAW, label="law")
    axes["a"].plot(speeds, points, **POINTS, color=BLUE, label="simulated")
    axes["a"].plot(fine[fine > 0], c + d * fine[fine > 0], **NOMINAL)
    axes["a"].annotate(
        "breakaway\nd_c + d_s", (0.0, c + s), (0.14, c + s - 0.35), arrowprops={"arrowstyle": "-"}
    )
    label(axes["a"], "speed [rad/s]", "friction [N m]", "friction-velocity map", "lower right")
    t = np.arange(3000) * 1e-3
    for color, speed in ((GREY, 0.3), (BLUE, 0.006)):
        bench = joint({"stribeck": law}, k_b=1500.0, d_m=0.0, d_g=2.2)
        x0 = np.full(6, speed) * np.array([0, 0, 0, 1, 1, 1]) if speed > 0.1 else None
        given = np.full(len(t), speed)
        record = bench.simulate(np.zeros(len(t)), given, x0=x0, dt_physics=1e-4)
        name = f"{1e3 * speed:g} mrad/s"
        axes["b"].plot(t, -record["true_tau"], color=color, lw=1.0, label=name)
    axes["b"].axhline(c + s, **LAW)
    axes["b"].set_ylim(0.0, 9.0)
    label(axes["b"], "time [s]", "joint torque [N m]", "output dragged at constant speed")
    axes["b"].legend(loc="upper right", ncols=2)
    return figure


@plot(
    (
        r"\dot z = \dot q - \frac{\sigma |\dot q| z}{g(\dot q)}, \quad \tau_f = "
        r"\sigma z + \sigma_1 \dot z"
        "\n"
        r"g(\dot q) = d_c + d_s e^{-(\dot q / v_s)^2} + \mu |\tau|"
    ),
    "Left: friction over displacement for motions of several amplitudes: closed, nested loops "
    "that are spring-like when small and become rectangles when large. Right: from rest, the "
    "bristles act as a spring of stiffness sigma (dotted) and yield to the Coulomb level "
    "(dashed); lines are d_c (1 - exp(-sigma x / d_c)).",
)
def presliding() -> Figure:
    """Draw nested presliding loops and the transition to sliding."""
    figure, axes = mosaic("ab", 3.0)
    level, sigma = 4.0, 4000.0
    effects = {"presliding": {"d_cm": level, "sigma_m": sigma}}
    for color, amplitude in zip(SEQUENCE, (4e-3, 2e-3, 1e-3, 0.4e-3), strict=True):
        t = np.arange(4001) * 1e-3
        angle = amplitude * np.sin(2.0 * np.pi * 0.5 * t)
        record = joint(effects, **LIGHT).simulate(
            np.zeros(4000), np.diff(angle) / 1e-3, dt_physics=1e-4
        )
        q, torque = 1e3 * record["true_q_m"], -record["true_tau"]
        axes["a"].plot(q[1500::8], torque[1500::8], color=color, label=f"± {1e3 * amplitude:g}")
    axes["a"].axhline(level, **NOMINAL)
    axes["a"].axhline(-level, **NOMINAL)
    label(axes["a"], "displacement [mrad]", "friction [N m]", "nested loops at 0.5 Hz")
    axes["a"].legend(loc="lower right", title="mrad")
    axes["a"].set_xlim(-4.4, 7.5)
    for color, stiffness in ((BLUE, 4000.0), (RED, 1500.0)):
        effects = {"presliding": {"d_cm": level, "sigma_m": stiffness}}
        bench = joint(effects, **LIGHT)
        record = bench.simulate(np.zeros(4000), np.full(4000, 1.5e-3), dt_physics=1e-4)
        q = record["true_q_m"]
        axes["b"].plot(1e3 * q, level * -np.expm1(-stiffness * q / level), **LAW)
        some = slice(1, None, 130)
        axes["b"].plot(1e3 * q[some], -record["true_tau"][some], **POINTS, color=color)
        axes["b"].plot([], [], **POINTS, color=color, label=f"sigma = {stiffness:g} N m/rad")
        axes["b"].plot([0.0, 1e3 * level / stiffness], [0.0, level], color=color, lw=0.8, ls=":")
    axes["b"].axhline(level, **NOMINAL)
    label(axes["b"], "displacement [mrad]", "friction [N m]", "from rest into sliding")
    axes["b"].legend(loc="lower right")
    return figure


@plot(
    r"\tau_f = (d_c + \mu |\tau|) \tanh\frac{\dot q}{\dot q_0}",
    "Left: friction over the transmitted torque in steady motion, a V on top of the Coulomb "
    "level. Right: joint torque over motor torque in steady motion, forwards and backwards; "
    "friction takes from the motor when it drives and holds back the load when it is driven, "
    "and the band between widens with load.",
)
def load_friction() -> Figure:
    """Draw friction over the transmitted torque, driving and driven."""
    figure, axes = mosaic("ab")
    torques = np.linspace(-80.0, 80.0, 17)
    fine = np.linspace(-120.0, 120.0, 241)
    for color, mu in ((BLUE, 0.05), (RED, 0.15)):
        effects = {"load_friction": {"mu_m": mu}, "coulomb": {"d_cm": 2.0, "d_cg": 0.0}}
        out = np.array([drag(effects, 0.05, tau_m) for tau_m in torques])
        axes["a"].plot(out, torques - out, **POINTS, color=color, label=f"μ = {mu:g}")
        axes["a"].plot(fine, 2.0 + mu * abs(fine), color=color, lw=0.9)
        back = np.array([drag(effects, -0.05, tau_m) for tau_m in torques])
        axes["b"].plot(torques, out, **POINTS, color=color)
        axes["b"].plot(torques, back, **HOLLOW, color=color)
        for way in (1.0, -1.0):
            axes["b"].plot(fine + way * (2.0 + mu * abs(fine)), fine, color=color, lw=0.8)
    axes["b"].plot([], [], **POINTS, color=GREY, label="turning forwards")
    axes["b"].plot([], [], **HOLLOW, color=GREY, label="turning backwards")
    axes["a"].set_ylim(0.0, 16.0)
    axes["a"].set_xlim(-92.0, 92.0)
    axes["b"].set_ylim(-110.0, 110.0)
    axes["b"].set_xlim(-85.0, 85.0)
    label(axes["a"], "transmitted torque [N m]", "friction [N m]", "", "lower right")
    label(axes["b"], "motor torque [N m]", "joint torque [N m]", "", "upper left")
    return figure


@plot(
    r"\tau_{f,l} = d_{cl} \tanh\frac{\dot q_l}{\dot q_0}",
    "Left: torque that the joint transmits to a load in steady motion, with and without viscous "
    "damping of the load. Right: a load that coasts loses speed in a straight line and stops at "
    "once; viscous damping alone would never stop it. Points are simulated, lines are the law.",
)
def load_coulomb() -> Figure:
    """Draw the friction of the load and how it coasts."""
    figure, axes = mosaic("ab")
    level = 1.9
    effects = {"load_coulomb": {"d_cl": level, "dq_0": 0.0}}
    speeds = np.concatenate([np.linspace(-2.0, -0.1, 8), np.linspace(0.1, 2.0, 8)])
    for d_l, color in ((0.0, BLUE), (0.8, RED)):
        bench = joint(effects, "rigid_gearbox", I_l=0.2, I_m=1e4, d_gl=50.0, d_g=0.0, d_l=d_l)
        taus = []
        for v in speeds:
            x0 = np.array([0.0, 0.0, 0.0, v, v, v])
            record = bench.simulate(np.zeros(1000), x0=x0, dt_physics=1e-4)
            taus.append(record["true_tau"][-300:].mean())
        axes["a"].plot(speeds, taus, **POINTS, color=color, label=f"d_l = {d_l:g} N m s/rad")
        fine = np.linspace(-2.0, 2.0, 801)
        axes["a"].plot(fine, level * np.sign(fine) + d_l * fine, color=color, lw=0.9)
        free = joint(effects, "rigid", I_m=0.1, I_g=0.0, I_l=0.2, d_m=0.0, d_g=0.0, d_l=d_l)
        record = free.simulate(np.zeros(500), x0=np.full(6, 2.0), dt_physics=1e-4)
        axes["b"].plot(1e3 * record["t"][::20], record["true_dq_l"][::20], **POINTS, color=color)
        t = np.linspace(0.0, 0.5, 501)
        law = 2.0 - level / 0.3 * t
        if d_l:
            law = (2.0 + level / d_l) * np.exp(-d_l / 0.3 * t) - level / d_l
        axes["b"].plot(1e3 * t, np.maximum(law, 0.0), color=color, lw=0.9)
    label(axes["a"], "speed of the load [rad/s]", "joint torque [N m]", "steady", "upper left")
    label(axes["b"], "time [ms]", "speed of the load [rad/s]", "coasting to a stop")
    return figure
