"""The electrical drives: what torque the motor gives for a command.

`current`  an ideal source, tau_m = k_t n i, limited to the peak current i_p.
`static`   voltage in, inductance neglected: i = (v - k_t n dq_m) / r.
`rl`       voltage in, one phase with inductance: l_a di/dt = v - r i - k_t n dq_m.
`dq`       voltage in, d-q axes of a surface permanent-magnet machine with p pole pairs.

Speeds are on the link side, hence the back-EMF constant k_t n. A voltage drive that is given
a torque applies the voltage that would hold the wanted current at the present speed,
v = r i + k_t n dq_m, as far as the supply v_0 allows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import check_name
from cjt_gym.joint.kernel.arrays import K_M, LAGGED, R_W, REFERENCE, OneJoint
from cjt_gym.joint.kernel.compiled import apart, lean

CURRENT, STATIC, RL, DQ = 0, 1, 2, 3

DRIVES: dict[str, str] = {
    "current": "ideal current source, limited to the peak current",
    "static": "voltage in, inductance neglected",
    "rl": "voltage in, one phase with inductance",
    "dq": "voltage in, d-q axes of a permanent-magnet machine",
}

NEEDED_PARAMETERS: dict[str, tuple[str, ...]] = {
    "current": ("n", "k_t"),
    "static": ("n", "k_t", "r", "v_0"),
    "rl": ("n", "k_t", "r", "v_0", "l_a"),
    "dq": ("n", "k_t", "r", "v_0", "l_a", "p"),
}


def get_drive(name: str) -> int:
    """Return the number of a drive in the kernel."""
    check_name("drive", name, DRIVES)
    return list(DRIVES).index(name)


@lean
def clip(x: float, limit: float) -> float:
    """Limit x to [-limit, limit]."""
    return min(max(x, -limit), limit)


@lean
def static_current(
    p: Any, k: float, r: float, command: float, is_voltage: bool, dq_m: float
) -> tuple[float, float]:
    """Return the current without inductance [A] and its slope over dq_m, <= 0 [A s/rad]."""
    if is_voltage:
        current, slope = (clip(command, p.v_0) - k * dq_m) / r, -k / r
    else:
        high, low = (p.v_0 - k * dq_m) / r, (-p.v_0 - k * dq_m) / r
        current, slope = command, 0.0
        if current > high:
            current, slope = high, -k / r
        elif current < low:
            current, slope = low, -k / r
    if abs(current) > p.i_p:
        return clip(current, p.i_p), 0.0
    return current, slope


@lean
def circle(v_q: float, v_d: float, limit: float) -> tuple[float, float]:
    """Shorten a voltage vector to the circle that the inverter can reach."""
    length = math.hypot(v_q, v_d)
    if length <= limit:
        return v_q, v_d
    return v_q * limit / length, v_d * limit / length


@lean
def applied_volts(
    joint: OneJoint, command: float, command_d: float, dq_m: float
) -> tuple[float, float]:
    """Return the voltages (v_q, v_d) that a drive with inductance applies [V].

    A torque command asks for i_d = 0. The voltage vector is limited to the circle of radius v_0.
    """
    p, k, r = joint.p, joint.memory[K_M], joint.memory[R_W]
    is_voltage = joint.setup.is_voltage
    if joint.setup.drive == RL:
        return clip(command if is_voltage else r * command + k * dq_m, p.v_0), 0.0
    if is_voltage:
        return circle(command, command_d, p.v_0)
    speed = p.p * p.n * dq_m
    v_d = -speed * p.l_a * command
    return circle(r * command + induced(p, k, dq_m), v_d, p.v_0)


@lean
def induced(p: Any, k: float, dq_m: float) -> float:
    """Return the voltage that the magnets induce on the q axis [V], p w lam of `advance_dq`."""
    return float(p.p * p.n * dq_m * (2.0 / 3.0) * k / (p.n * p.p))


@lean
def advance_rl(
    p: Any, k: float, r: float, current: float, voltage: float, dq_m: float, h: float
) -> float:
    """Return the phase current after h [s] at constant speed, exactly.

    The drive's protection holds the current within +- i_p.
    """
    final = (voltage - k * dq_m) / r
    return clip(final + (current - final) * math.exp(-r * h / p.l_a), p.i_p)


@lean
def advance_dq(
    p: Any, k: float, r: float, current: complex, voltage: complex, dq_m: float, h: float
) -> tuple[float, float]:
    """Return the currents (i_q, i_d) after h [s] at constant speed, exactly.

        l_a di_q/dt = v_q - r i_q - p w (l_a i_d + lam)
        l_a di_d/dt = v_d - r i_d + p w l_a i_q,     w = n dq_m, lam = (2/3) k / (n p)

    which for the current z = i_q + j i_d is dz/dt = (-r / l_a + j p w) z + u, with u from the
    voltage v_q + j v_d. The current vector is limited to the circle of radius i_p.

    References:
        Sue, Pan (2008), IEEE Transactions on Industrial Electronics 55(1).
    """
    rate = complex(-r / p.l_a, p.p * p.n * dq_m)
    drive = complex((voltage.real - induced(p, k, dq_m)) / p.l_a, voltage.imag / p.l_a)
    decay = math.exp(rate.real * h)
    turn = complex(decay * math.cos(rate.imag * h), decay * math.sin(rate.imag * h))
    z = turn * current + (turn - 1.0) / rate * drive
    return circle(z.real, z.imag, p.i_p)


@apart
def advance_currents(
    joint: OneJoint, command: float, command_d: float, dq_m: float, h: float
) -> None:
    """Advance the currents [i_q, i_d] of a drive with inductance by h [s], in place."""
    p, k, r, currents = joint.p, joint.memory[K_M], joint.memory[R_W], joint.currents
    v_q, v_d = applied_volts(joint, command, command_d, dq_m)
    if joint.setup.drive == RL:
        currents[0] = advance_rl(p, k, r, currents[0], v_q, dq_m, h)
    else:
        z, v = complex(currents[0], currents[1]), complex(v_q, v_d)
        currents[0], currents[1] = advance_dq(p, k, r, z, v, dq_m, h)


@lean
def shaped_command(p: Any, memory: NDArray[np.float64], command: float, h: float) -> float:
    """Return the mean current that a drive follows over h [s], behind rate limit and lag.

    The rate limit moves the reference to the command in a straight line; the lag follows the mean
    reference exactly.
    """
    if p.current_rate > 0.0:
        old = memory[REFERENCE]
        change = clip(command - old, p.current_rate * h)
        spent = abs(change) / (p.current_rate * h)
        memory[REFERENCE] = old + change
        command = old + change * (1.0 - 0.5 * spent)
    if p.current_bandwidth > 0.0:
        old, a = memory[LAGGED], 2.0 * math.pi * p.current_bandwidth * h
        gap = old - command
        memory[LAGGED] = command + gap * math.exp(-a)
        command -= gap * math.expm1(-a) / a
    return command
