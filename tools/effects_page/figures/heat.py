"""Figure of the two-stage thermal model."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm

from cjt_gym.joint.batch import JointBatch
from cjt_gym.joint.kernel.arrays import HOUSING, K_M, WINDING
from tools.effects_page.bench import Floats, joint
from tools.effects_page.plot import plot
from tools.effects_page.style import BLUE, GREY, LAW, POINTS, RED, label, mosaic

R, R_1, R_2, T_W, T_H = 0.318, 10.0, 15.0, 60.0, 3000.0
DERATING = 0.002


def heated(current: float, copper: float, samples: int) -> Floats:
    """Return rise of winding and housing [K] and torque per ampere [N m/A] at each second."""
    stages = {"r_th1": R_1, "r_th2": R_2, "T_thw": T_W, "T_thm": T_H}
    effects = {"thermal_derating": {"derating": DERATING, "a_CU": copper, **stages}}
    batch = JointBatch(joint(effects), 1, 1.0, 1.0)
    batch.seed(0, 0)
    batch.restart(np.ones(1, dtype=np.bool_), np.zeros(1))
    out = np.zeros((samples, 3))
    for k in range(samples):
        memory = batch.arrays.memory[0]
        out[k] = memory[WINDING], memory[HOUSING], memory[K_M]
        batch.step(np.array([[current, 0.0]]), np.zeros(1))
    return out


def two_exponentials(current: float, t: Floats) -> Floats:
    """Return rise of winding and housing [K] for a constant loss, shape (len(t), 2)."""
    c_w, c_h = T_W / R_1, T_H / R_2
    a = np.array([[-1.0 / R_1 / c_w, 1.0 / R_1 / c_w], [1.0 / R_1 / c_h, 0.0]])
    a[1, 1] = -(1.0 / R_1 + 1.0 / R_2) / c_h
    steady = -np.linalg.solve(a, [R * current**2 / c_w, 0.0])
    return np.array([steady - expm(a * x) @ steady for x in t])


@plot(
    (
        r"C_w \dot T_w = r (1 + a_\mathrm{CU} T_w)\,i^2 - \frac{T_w - "
        r"T_h}{r_{th1}}, \quad C_w = \frac{T_{thw}}{r_{th1}}"
        "\n"
        r"C_h \dot T_h = \frac{T_w - T_h}{r_{th1}} - \frac{T_h}{r_{th2}}, \quad C_h "
        r"= \frac{T_{thm}}{r_{th2}}"
        "\n"
        r"k_t(T_w) = k_t (1 - \mathrm{derating}\,T_w), \quad r(T_w) = r (1 + "
        r"a_\mathrm{CU} T_w)"
    ),
    "Left: rise of winding and housing under constant current. The winding leaves the housing "
    "behind within its own time constant, then both follow the housing. Points are simulated "
    "with constant resistance, on the sum of two exponentials; dashed with copper that heats "
    "itself more as it warms. Right: torque per ampere falls with the winding's rise.",
)
def thermal_derating() -> Figure:
    """Draw the rise of winding and housing, and the torque per ampere that is left."""
    figure, axes = mosaic("ab", 2.9, width_ratios=(1.25, 1.0))
    t = np.arange(20_000.0)
    some = np.unique(np.round(np.geomspace(3.0, 19_000.0, 26)).astype(int))
    fine = np.geomspace(2.0, 20_000.0, 120)
    shown = np.unique(np.round(np.geomspace(2.0, 19_999.0, 150)).astype(int))
    plain, full = heated(3.0, 0.0, len(t)), heated(3.0, 0.0039, len(t))
    law = two_exponentials(3.0, fine)
    for color, column, name in ((RED, 0, "winding"), (BLUE, 1, "housing")):
        axes["a"].semilogx(fine, law[:, column], **LAW)
        axes["a"].plot(some - 1, plain[some, column], **POINTS, color=color, label=name)
        axes["a"].plot(t[shown], full[shown, column], color=color, lw=1.0, ls=(0, (4, 2)))
    axes["a"].plot([], [], **LAW, label="two exponentials")
    axes["a"].plot([], [], color=GREY, lw=1.0, ls=(0, (4, 2)), label="with a_CU")
    label(axes["a"], "time [s]", "rise above ambient [K]", "3 A at blocked output", "upper left")
    axes["a"].set_xlim(3.0, 2e4)
    for color, current in ((BLUE, 1.5), (RED, 3.0)):
        record = full if current == 3.0 else heated(current, 0.0039, len(t))
        axes["b"].semilogx(t[shown], 100.0 * record[shown, 2] / record[0, 2], color=color)
        axes["b"].plot([], [], color=color, label=f"{current:g} A")
        expected = 100.0 * (1.0 - DERATING * record[some, 0])
        axes["b"].plot(some, expected, **POINTS, color=color)
    axes["b"].plot([], [], **POINTS, color=GREY, label="1 - derating · rise")
    label(axes["b"], "time [s]", "torque per ampere [% of cold]", "", "lower left")
    axes["b"].set_xlim(3.0, 2e4)
    return figure
