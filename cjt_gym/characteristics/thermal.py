"""Temperatures of winding and housing under a torque: where they end, and when it is too hot.

    C_w dT_w/dt = r (1 + a_CU (T_w - T_A)) i^2 - (T_w - T_h) / r_th1
    C_h dT_h/dt = (T_w - T_h) / r_th1 - (T_h - T_A) / r_th2

with C_w = T_thw / r_th1, C_h = T_thm / r_th2 and T_A = Tmp_ANom, the ambient at which r holds.
Under a constant current this is linear, and solved exactly. Iron losses are not in it.

References:
    maxon motor (2014), The selection of high-precision microdrives, chapter 7;
    Hendershot, Miller (2010), Design of Brushless Permanent-Magnet Machines.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from cjt_gym.characteristics.motor import Floats, torque_per_ampere
from cjt_gym.errors import ParameterError
from cjt_gym.joint import JointParameters

FOREVER = 1e9
"""Longest time that is looked at [s]."""


def rms(values: ArrayLike) -> float:
    """Return the root mean square of evenly sampled values [their unit].

    A torque profile that repeats much faster than T_thw heats like a constant torque of this size.
    """
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))


def steady_temperature(p: JointParameters, tau: ArrayLike) -> Floats:
    """Return where the winding's temperature ends [degC] at a constant torque.

    T_A + R P / (1 - a_CU R P) with R = r_th1 + r_th2 and P = r i^2; infinite where the
    resistance rises faster than heat can leave.

    Args:
        p: Parameters.
        tau: Motor torque, or its rms [N m].
    """
    current = np.asarray(tau, dtype=np.float64) / torque_per_ampere(p)
    cold = (p.r_th1 + p.r_th2) * p.r * current**2
    left = 1.0 - p.get("a_CU", 0.0) * cold
    stays = left > 0.0
    return np.where(stays, p.Tmp_ANom + cold / np.where(stays, left, 1.0), np.inf)


def time_to_critical(
    p: JointParameters,
    tau: float,
    winding: float | None = None,
    housing: float | None = None,
) -> float:
    """Return how long a constant torque can be held until the winding is at Tmp_WMax [s].

    Args:
        p: Parameters.
        tau: Motor torque [N m].
        winding: Temperature at the start [degC]; ambient if absent.
        housing: Likewise; if absent, where it is when the winding has been at its temperature
            for long.

    Returns:
        The time; 0 where it is that hot already, infinity where it never will be.
    """
    start = _start(p, winding, housing)
    limit = p.Tmp_WMax - p.Tmp_ANom
    if start[0] >= limit:
        return 0.0
    rates, modes, offsets = _solution(p, tau, start)

    def excess(t: float) -> float:
        grown = np.expm1(np.minimum(rates * t, 600.0)) / np.where(rates == 0.0, 1.0, rates)
        grown = np.where(rates == 0.0, t, grown)
        return float(start[0] + modes[0] @ (offsets * grown)) - limit

    # Two exponentials have one extremum at most, so that each piece between is monotone.
    slopes = modes[0] * offsets
    times = [0.0]
    if slopes[0] * slopes[1] < 0.0 and rates[0] != rates[1]:
        turn = math.log(-slopes[0] / slopes[1]) / (rates[1] - rates[0])
        if 0.0 < turn < FOREVER:
            times.append(turn)
    times.append(FOREVER)
    for low, high in pairwise(times):
        if excess(high) >= 0.0:
            return float(brentq(excess, low, high, xtol=1e-9, rtol=1e-12))
    return math.inf


def temperatures(
    p: JointParameters,
    tau: ArrayLike,
    dt: float,
    winding: float | None = None,
    housing: float | None = None,
) -> Floats:
    """Return winding and housing temperature under a torque profile, shape (samples + 1, 2) [degC].

    Args:
        p: Parameters.
        tau: Motor torque, each held for dt, shape (samples,) [N m].
        dt: Sample time [s].
        winding: As for `time_to_critical`.
        housing: Likewise.
    """
    profile = np.asarray(tau, dtype=np.float64)
    out = np.empty((len(profile) + 1, 2))
    out[0] = _start(p, winding, housing)
    for k, torque in enumerate(profile):
        rates, modes, offsets = _solution(p, float(torque), out[k])
        grown = np.where(
            rates == 0.0, dt, np.expm1(rates * dt) / np.where(rates == 0.0, 1.0, rates)
        )
        out[k + 1] = out[k] + modes @ (offsets * grown)
    return out + p.Tmp_ANom


def _start(p: JointParameters, winding: float | None, housing: float | None) -> Floats:
    """Return both temperatures at the start, above ambient [K]."""
    hot = 0.0 if winding is None else winding - p.Tmp_ANom
    share = p.r_th2 / (p.r_th1 + p.r_th2)
    warm = hot * share if housing is None else housing - p.Tmp_ANom
    if not (math.isfinite(hot) and math.isfinite(warm)):
        raise ParameterError(
            f"Temperatures at the start must be finite [degC], got winding {winding}, housing "
            f"{housing}."
        )
    return np.array([hot, warm])


def _solution(p: JointParameters, tau: float, start: Floats) -> tuple[Floats, Floats, Floats]:
    """Return rates [1/s], modes (columns) and rates of change in them [K/s] at the start.

    The temperatures are start + modes @ (offsets (exp(rates t) - 1) / rates).
    """
    power = p.r * (tau / torque_per_ampere(p)) ** 2
    winding, housing = p.T_thw / p.r_th1, p.T_thm / p.r_th2
    leaves = 1.0 / p.r_th1
    gains = p.get("a_CU", 0.0) * power
    a = np.array(
        [
            [(gains - leaves) / winding, leaves / winding],
            [leaves / housing, -(leaves + 1.0 / p.r_th2) / housing],
        ]
    )
    scale = np.sqrt(np.array([winding, housing]))  # makes it symmetric, so that modes are real
    rates, modes = np.linalg.eigh(0.5 * ((m := scale[:, None] * a / scale) + m.T))
    change = a @ start + np.array([power / winding, 0.0])
    offsets = modes.T @ (scale * change)
    return rates, modes / scale[:, None], offsets
