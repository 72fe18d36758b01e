"""The current controller of a voltage drive: PI on both axes, with decoupling and anti-windup.

    v_q = k dq_m + w_e l i_d + kp e_q + ki z_q,     e_q = i_wanted - i_q,
    v_d =        - w_e l i_q + kp e_d + ki z_d,     e_d = -i_d,      w_e = p n dq_m
    z[k+1] = z[k] + T (e + (v_applied - v) / (kp + r)),     kp = w l,  ki = w r

Internal-model control: the controller's zero cancels the winding's pole r / l, so that the current
follows as a first-order lag with bandwidth w. Back-EMF (k is two thirds of k_t n in d-q axes) and
the coupling of the axes are fed forward. Voltage that the supply cuts off does not wind up the
integrals. Without inductance (`static`) only the integral acts; with one phase there is only the q
axis.

The controller has its own sample rate and its own values of r, l and k_t, which may be wrong.

References:
    Harnefors, Nee (1998), Model-based current control of AC machines using the internal model
    control method, IEEE Transactions on Industry Applications 34(1).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.configure import resolve_effects
from cjt_gym.joint.effects import EFFECTS
from cjt_gym.joint.kernel.arrays import K_M, R_W, REGULATOR, Floats, OneJoint, Setup
from cjt_gym.joint.kernel.compiled import apart, lean
from cjt_gym.joint.kernel.drives import CURRENT, DQ, STATIC, applied_volts, circle, clip

if TYPE_CHECKING:
    from cjt_gym.joint.joint import Joint

NAME = "current_control"
FASTEST = 0.5
"""Largest bandwidth over the sample rate, w T: beyond it the sampled loop overshoots."""
TYPICAL_RATE, TYPICAL_SHARE = 1e4, 0.05
"""Default loop: sample rate [Hz], and ratio of sample rate to bandwidth [Hz]."""


@lean
def regulate(
    p: Any, drive: int, loop: Floats, wanted: float, currents: Floats, dq_m: float, period: float
) -> None:
    """Write the voltages [V] until the next sample, and advance the integrals [A s], in place.

    `loop` holds the integrals on q and d axis, and the voltages on both. The gains are those that
    the controller was told, `loop_...` of the parameter record.
    """
    w = min(2.0 * math.pi * p.loop_bandwidth, FASTEST / period)
    i_q, i_d, integrals, volts = currents[0], currents[1], loop[:2], loop[2:]
    inductance = 0.0 if drive == STATIC else p.loop_l_a
    kp, ki, share = w * inductance, w * p.loop_r, 2.0 / 3.0 if drive == DQ else 1.0
    e_q, e_d = clip(wanted, p.i_p) - i_q, -i_d
    v_q = share * p.loop_k_t * p.n * dq_m + kp * e_q + ki * integrals[0]
    v_d = 0.0
    if drive == DQ:
        cross = p.p * p.n * dq_m * inductance
        v_q += cross * i_d
        v_d = kp * e_d + ki * integrals[1] - cross * i_q
        volts[0], volts[1] = circle(v_q, v_d, p.v_0)
    else:
        volts[0], volts[1] = clip(v_q, p.v_0), 0.0
    back = kp + p.loop_r
    integrals[0] += period * (e_q + (volts[0] - v_q) / back)
    integrals[1] += period * (e_d + (volts[1] - v_d) / back) if drive == DQ else 0.0


@lean
def substeps_per_sample(p: Any, setup: Setup) -> int:
    """Return the substeps between two samples of the controller: the nearest whole number."""
    return int(max(1, round(1.0 / (p.loop_rate * setup.h))))


@lean
def closes(p: Any, setup: Setup) -> bool:
    """Whether there is a current controller between the command and the voltage."""
    return setup.drive != CURRENT and not setup.is_voltage and p.loop_bandwidth > 0.0


@apart
def regulated_command(joint: OneJoint, at: int, command: float, dq_m: float) -> tuple[float, float]:
    """Return the voltages (v_q, v_d) of substep `at` since the reset; sample when it is due."""
    p, setup = joint.p, joint.setup
    every = substeps_per_sample(p, setup)
    loop = joint.memory[REGULATOR : REGULATOR + 4]
    if at % every == 0:
        regulate(p, setup.drive, loop, command, joint.currents, dq_m, every * setup.h)
    return loop[2], loop[3]


@apart
def terminal_volts(
    joint: OneJoint, command: float, command_d: float, dq_m: float
) -> tuple[float, float]:
    """Return the voltages (v_q, v_d) at the winding, whatever makes them [V]."""
    if joint.setup.drive == STATIC:
        return joint.memory[R_W] * joint.currents[0] + joint.memory[K_M] * dq_m, 0.0
    return applied_volts(joint, command, command_d, dq_m)


def with_current_loop(joint: Joint, dt_physics: float) -> Joint:
    """Return a joint whose voltage drive has a current controller: its own, or a typical one.

    A drive that takes currents, and one whose effects say what its loop is (a bandwidth of 0 is
    none), stay as they are.
    """
    if joint.drive == "current" or NAME in joint.effects or not dt_physics > 0.0:
        return joint
    rate = min(TYPICAL_RATE, 1.0 / dt_physics)
    values = {"bandwidth": TYPICAL_SHARE * rate, "rate": rate}
    own = resolve_effects({NAME: values}, joint.file, joint.structure_row, joint.drive)
    every = {**own, **joint.effects}
    return replace(joint, effects={name: every[name] for name in EFFECTS if name in every})


def longest_sample(joint: Joint) -> float:
    """Return the substep up to which the current controller keeps its rate [s]."""
    if joint.setting(NAME, "bandwidth") == 0.0:
        return math.inf
    return (1.0 + 1e-6) / joint.setting(NAME, "rate")


def check_loop(joint: Joint, h: float) -> None:
    """Raise ConfigurationError where the controller cannot keep its rate or bandwidth."""
    bandwidth, rate = (joint.setting(NAME, symbol) for symbol in ("bandwidth", "rate"))
    if bandwidth == 0.0:
        return
    if h > longest_sample(joint):
        raise ConfigurationError(
            f"dt_physics must be <= {1.0 / rate:.4g} s, as effect {NAME} of "
            f"{joint.parameters.name} samples at {rate:g} Hz, got {h:g} s. Give a shorter substep "
            "or a lower rate."
        )
    period = max(1, round(1.0 / (rate * h))) * h
    highest = FASTEST / (2.0 * math.pi * period)
    if bandwidth > highest * (1.0 + 1e-9):
        raise ConfigurationError(
            f"bandwidth of effect {NAME} of {joint.parameters.name} must be <= {highest:.4g} Hz "
            f"where the controller samples every {period:g} s, got {bandwidth:g}. Ask for less, or "
            "give a higher rate and a shorter dt_physics."
        )
