"""Points and constants of a joint's drive: rated, no-load, stall and peak; all on the link side.

The motor is a voltage source v_0 behind the resistance r, and k = k_t n is its torque per ampere at
the link. Friction is that of positive velocity, summed over motor, gear and load.

References:
    maxon motor (2014), The selection of high-precision microdrives, chapters 3 and 7.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cjt_gym.errors import ParameterError
from cjt_gym.joint import JointParameters

Floats = NDArray[np.float64]
Number = TypeVar("Number", float, Floats)


def torque_per_ampere(p: JointParameters) -> float:
    """Return k = k_t n [N m/A].

    Raises:
        ParameterError: The joint lacks one of them, or its amplifier takes volts.
    """
    if p.takes_volts:
        raise ParameterError(
            f"k_t of {p.origin} is in {p.unit('k_t')}, torque per volt of an amplifier; current, "
            "heat and power do not follow from it. Give it in N m/A or N/A."
        )
    return p.k_t * p.n


def coulomb(p: JointParameters) -> float:
    """Return the Coulomb friction of all bodies [N m]."""
    return sum(p.get(name, 0.0) for name in ("d_cm", "d_cg", "d_cl"))


def viscous(p: JointParameters) -> float:
    """Return the viscous friction of all bodies [N m s/rad]."""
    return sum(p.get(name, 0.0) for name in ("d_m", "d_g", "d_l"))


def friction(p: JointParameters, dq: Number) -> Number:
    """Return the friction torque at a positive velocity, Coulomb + viscous dq [N m]."""
    return coulomb(p) + viscous(p) * dq


def speed_drop(p: JointParameters) -> float:
    """Return the slope of the torque-speed line, r / (k_t n)^2 [rad/(s N m)]."""
    return p.r / torque_per_ampere(p) ** 2


def zero_torque_speed(p: JointParameters) -> float:
    """Return the velocity at which the back-EMF is the supply, v_0 / (k_t n) [rad/s]."""
    return p.v_0 / torque_per_ampere(p)


def no_load_speed(p: JointParameters) -> float:
    """Return the velocity at which friction takes all torque of the line [rad/s].

    It is zero where the stall torque does not overcome Coulomb friction.
    """
    slope = speed_drop(p)
    free = zero_torque_speed(p) - slope * coulomb(p)
    return max(0.0, free / (1.0 + slope * viscous(p)))


def no_load_torque(p: JointParameters) -> float:
    """Return the friction at the no-load speed [N m]."""
    return friction(p, no_load_speed(p))


def starting_current(p: JointParameters) -> float:
    """Return v_0 / r [A]; most drives limit it to i_p."""
    return p.v_0 / p.r


def stall_torque(p: JointParameters) -> float:
    """Return the torque of the starting current [N m]."""
    return torque_per_ampere(p) * starting_current(p)


def continuous_current(p: JointParameters) -> float:
    """Return the current at which the winding ends at its highest temperature [A].

    sqrt(dT / ((r_th1 + r_th2) r (1 + a_CU dT))) with dT = Tmp_WMax - Tmp_ANom.
    """
    rise = p.Tmp_WMax - p.Tmp_ANom
    ohms = p.r * (1.0 + p.get("a_CU", 0.0) * rise)
    return math.sqrt(max(0.0, rise) / ((p.r_th1 + p.r_th2) * ohms))


def rated_torque(p: JointParameters) -> float:
    """Return the torque of the continuous current [N m]."""
    return torque_per_ampere(p) * continuous_current(p)


def rated_speed(p: JointParameters) -> float:
    """Return the velocity of the torque-speed line at the rated torque [rad/s]."""
    return speed_at_torque(p, rated_torque(p))


def peak_torque(p: JointParameters) -> float:
    """Return the torque of the peak current, k_t n i_p [N m]."""
    return torque_per_ampere(p) * p.i_p


def peak_mechanical_power(p: JointParameters) -> float:
    """Return the largest power on the torque-speed line up to the peak torque [W]."""
    torque = min(peak_torque(p), 0.5 * stall_torque(p))
    return torque * speed_at_torque(p, torque)


def usable_power(p: JointParameters) -> float:
    """Return the same with velocities up to dq_p, where the joint has it [W]."""
    fastest, torque = p.get("dq_p", math.inf), min(peak_torque(p), 0.5 * stall_torque(p))
    if speed_at_torque(p, torque) <= fastest:
        return peak_mechanical_power(p)
    return fastest * min(peak_torque(p), (zero_torque_speed(p) - fastest) / speed_drop(p))


def speed_at_torque(p: JointParameters, tau: Number) -> Number:
    """Return the velocity of the torque-speed line [rad/s], v_0/(k_t n) - tau r/(k_t n)^2.

    Args:
        p: Parameters.
        tau: Motor torque [N m], friction included.
    """
    return zero_torque_speed(p) - speed_drop(p) * tau


def highest_speed(p: JointParameters, tau: Floats, *, continuous: bool = False) -> Floats:
    """Return the highest steady velocity at which the motor can give a torque [rad/s].

    That is the least of the torque-speed line, the velocity at which friction takes the whole
    torque, and dq_p where the joint has it; zero where the torque does not overcome Coulomb
    friction or exceeds the peak (or rated) torque.

    Args:
        p: Parameters.
        tau: Motor torque [N m], >= 0.
        continuous: Whether it is to be held for ever.
    """
    tau = np.asarray(tau, dtype=np.float64)
    spare, damping = tau - coulomb(p), viscous(p)
    by_friction = spare / damping if damping > 0.0 else np.where(spare > 0.0, np.inf, 0.0)
    speed = np.minimum(speed_at_torque(p, tau), by_friction)
    speed = np.minimum(speed, p.get("dq_p", math.inf))
    allowed = tau <= (rated_torque(p) if continuous else peak_torque(p))
    return np.where(allowed, np.maximum(speed, 0.0), 0.0)


def efficiency(p: JointParameters, tau: Floats, dq: Floats) -> Floats:
    """Return the efficiency of driving at a torque and velocity, anywhere in the plane [-].

        eta = (tau - friction(dq)) dq / (r i^2 + tau dq),   i = tau / (k_t n)

    Args:
        p: Parameters.
        tau: Motor torque [N m], friction included.
        dq: Velocity [rad/s].

    Returns:
        Efficiency; NaN where friction takes all, or where the supply is too low for the point.
    """
    tau, dq = np.broadcast_arrays(np.asarray(tau, float), np.asarray(dq, float))
    out = (tau - friction(p, dq)) * dq
    power = speed_drop(p) * tau**2 + tau * dq
    reachable = dq <= speed_at_torque(p, tau) * (1.0 + 1e-12)
    good = (out >= 0.0) & (power > 0.0) & reachable
    return np.where(good, out / np.where(good, power, 1.0), np.nan)


def best_point(p: JointParameters) -> tuple[float, float]:
    """Return motor torque [N m] and velocity [rad/s] of the largest efficiency.

    At a given velocity it is at tau = f + sqrt(f^2 + f dq / s), with friction f and the slope s
    of the torque-speed line, or at the limit of voltage or peak current.
    """
    slope, largest = speed_drop(p), peak_torque(p)
    fastest = min(no_load_speed(p), p.get("dq_p", math.inf))

    def best_torque(dq: float) -> float:
        lost = friction(p, dq)
        best = lost + math.sqrt(lost**2 + lost * dq / slope)
        return min(best, largest, (zero_torque_speed(p) - dq) / slope)

    found = minimize_scalar(
        lambda dq: -_efficiency_at(p, best_torque(dq), dq),
        bounds=(1e-9 * fastest, fastest),
        method="bounded",
        options={"xatol": 1e-9 * fastest},
    )
    return best_torque(float(found.x)), float(found.x)


def best_efficiency(p: JointParameters) -> float:
    """Return the largest efficiency within supply voltage and peak current [-]; 0 if none."""
    if no_load_speed(p) == 0.0:
        return 0.0
    return max(0.0, _efficiency_at(p, *best_point(p)))


def _efficiency_at(p: JointParameters, tau: float, dq: float) -> float:
    """Return the efficiency at a point; without friction it tends to 1 where the torque is 0."""
    lost = float(friction(p, dq))
    return (1.0 - lost / tau if lost else 1.0) * dq / (speed_drop(p) * tau + dq)
