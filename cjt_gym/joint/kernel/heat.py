"""Winding and housing warm up; the torque constant falls and the resistance rises.

    C_w dT_w/dt = r i^2 - (T_w - T_h) / r_th1
    C_h dT_h/dt = (T_w - T_h) / r_th1 - T_h / r_th2

with temperatures above ambient, C_w = T_thw / r_th1 and C_h = T_thm / r_th2.

References:
    Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB, parameters r_th1, r_th2,
    T_thw, T_thm; Hendershot, Miller (2010), Design of Brushless Permanent-Magnet Machines.
"""

from __future__ import annotations

from typing import Any

from cjt_gym.joint.kernel.arrays import HOUSING, K_M, R_W, WINDING, Floats
from cjt_gym.joint.kernel.compiled import lean

LEAST = 0.05  # share of torque constant that is left at any temperature


@lean
def cool(p: Any, memory: Floats) -> None:
    """Start at the initial temperature."""
    memory[WINDING], memory[HOUSING] = p.heat_rise, 0.0
    temper(p, memory)


@lean
def temper(p: Any, memory: Floats) -> None:
    """Set torque per ampere and resistance for the present temperature."""
    memory[K_M], memory[R_W] = p.k_t * p.n, p.r
    if p.derating > 0.0 or p.heat_a_CU > 0.0:
        rise = memory[WINDING]
        memory[K_M] *= max(LEAST, 1.0 - p.derating * rise)
        memory[R_W] *= max(LEAST, 1.0 + p.heat_a_CU * rise)


@lean
def warm(p: Any, memory: Floats, currents: Floats, dt: float) -> None:
    """Advance the temperatures by dt [s] under the present currents (backward Euler)."""
    rise = memory[WINDING]
    ohms = p.heat_r * max(LEAST, 1.0 + p.heat_a_CU * rise)
    power = ohms * (currents[0] * currents[0] + currents[1] * currents[1])
    a, c = dt / p.heat_T_thw, dt / p.heat_T_thm
    share = p.heat_r_th2 / p.heat_r_th1
    # (1 + a) T_w - a T_h = T_w' + a r_th1 P;  -c share T_w + (1 + c + c share) T_h = T_h'
    left, right = rise + a * p.heat_r_th1 * power, memory[HOUSING]
    below = 1.0 + c + c * share
    determinant = (1.0 + a) * below - a * c * share
    memory[WINDING] = (left * below + a * right) / determinant
    memory[HOUSING] = ((1.0 + a) * right + c * share * left) / determinant
    temper(p, memory)
