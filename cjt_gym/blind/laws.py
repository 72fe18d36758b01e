"""Laws of force of one joint, as scalar functions of its state.

Both integrators, the fine-step one and the one that detects events, call these. Torques are on the
link side [N m]; friction levels are the largest torque that a dry contact can hold. `warm` is the
progress of warming up.
"""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.plant import GEAR, LOAD, MOTOR, Floats, Plant
from cjt_gym.blind.state import (
    BRISTLE,
    CREEP,
    CURRENT,
    HEAT,
    PLACE,
    SLIP,
    SLIPS,
    WEN,
    Q,
    V,
)

COLDEST_TORQUE = 0.2
"""Share of the torque constant that remains however hot the winding is."""


@jit
def motor_torque(p: Plant, x: Floats) -> float:
    """Return the torque of the current: k_t n i (1 - loss * heat)."""
    return float(p.k_t * p.n * x[CURRENT] * max(1.0 - p.heat_loss * x[HEAT], COLDEST_TORQUE))


@jit
def half_play(p: Plant, q_m: float) -> float:
    """Return half of the play at this angle of the motor [rad]."""
    if p.loose == 0.0:
        return 0.5 * p.play
    return 0.5 * p.play + 0.25 * p.loose * (1.0 + math.cos(p.loose_f * q_m + p.loose_phase))


@jit
def beyond(twist: float, half: float) -> float:
    """Return how far a twist goes beyond the play on either side [rad]."""
    if twist > half:
        return twist - half
    if twist < -half:
        return twist + half
    return 0.0


@jit
def slip_share(element: int) -> tuple[float, float]:
    """Return the share of the torque and the relative width of a slip element."""
    return 1.0 / SLIPS, 0.5 * (element + 1)


@jit
def bar_torque(p: Plant, x: Floats, twist: float) -> float:
    """Return the torque of the torsion bar without its damping.

    tau = k_b (1 +- skew) (twist - creep) + k_3 twist^3 + hysteresis
    """
    stiffness = p.k_b * (1.0 + p.skew if twist > 0.0 else 1.0 - p.skew)
    torque = stiffness * (twist - x[CREEP]) + p.k_3 * twist * twist * twist
    if p.slip_torque > 0.0:
        for e in range(SLIPS):
            share, width = slip_share(e)
            torque += p.slip_torque * share * x[SLIP + e] / (width * p.slip_width)
    if p.wen_torque > 0.0:
        torque += p.wen_torque * x[WEN] / p.wen_width
    return float(torque)


@jit
def wen_rate(z: float, width: float, sense: float) -> float:
    """Return dz / d(twist) of the Bouc-Wen law with exponent 2: elastic when unloading.

    Source: Bouc (1967), Wen (1976), A = 1, beta = gamma = 0.5 / width^2.
    """
    return 1.0 - (z / width) ** 2 if sense * z > 0.0 else 1.0


@jit
def twist_memories(p: Plant, x: Floats, change: float) -> None:
    """Move the memories of the bar along with its twist, in place.

    Slip elements stick until their width is used up (Iwan 1966). The Bouc-Wen law is taken by the
    midpoint rule, exact enough for the small changes of a fine step.
    """
    if p.slip_torque > 0.0:
        for e in range(SLIPS):
            _, width = slip_share(e)
            limit = width * p.slip_width
            x[SLIP + e] = min(max(x[SLIP + e] + change, -limit), limit)
    if p.wen_torque > 0.0:
        sense = 1.0 if change > 0.0 else -1.0
        middle = x[WEN] + 0.5 * change * wen_rate(x[WEN], p.wen_width, sense)
        x[WEN] += change * wen_rate(middle, p.wen_width, sense)


@jit
def bristle_level(p: Plant, body: int) -> float:
    """Return the level of presliding friction of a body."""
    if body == MOTOR:
        return p.bristle_m
    return p.bristle_g if body == GEAR else p.bristle_l


@jit
def drag_bristles(p: Plant, x: Floats) -> None:
    """Move the bristles along with their bodies, in place; exact for motion in one direction.

    Source: Dahl (1968), dz/dq = 1 - sgn(dq) z / z_s.
    """
    if p.bristle_m + p.bristle_g + p.bristle_l == 0.0:
        return
    for body in range(3):
        change = x[Q + body] - x[PLACE + body]
        x[PLACE + body] = x[Q + body]
        if change != 0.0:
            end = p.z_s if change > 0.0 else -p.z_s
            x[BRISTLE + body] = end + (x[BRISTLE + body] - end) * math.exp(-abs(change) / p.z_s)


@jit
def friction_levels(
    p: Plant, body: int, v: float, torque: float, q_m: float, warm: float
) -> tuple[float, float]:
    """Return the levels of dry friction of a body for positive and negative motion."""
    if body == MOTOR:
        up, down, rise, mu = p.up_m, p.down_m, p.rise_m, p.mu_m
        if p.cold > 0.0:
            extra = p.cold * math.exp(-warm)
            up, down = up + extra, down + extra
        if p.spot > 0.0:
            extra = 0.5 * p.spot * (1.0 + math.cos(p.spot_f * q_m + p.spot_phase))
            up, down = up + extra, down + extra
    elif body == GEAR:
        up, down, rise, mu = p.up_g, p.down_g, p.rise_g, p.mu_g
    else:
        up, down, rise, mu = p.up_l, p.down_l, p.rise_l, 0.0
    if rise > 0.0:
        extra = rise * math.exp(-((v / p.v_s) ** 2))
        up, down = up + extra, down + extra
    extra = mu * abs(torque)
    return up + extra, down + extra


@jit
def ripple(a: float, b: float, f: float, q: float) -> float:
    """Return a cos(f q) + b sin(f q)."""
    if a == 0.0 and b == 0.0:
        return 0.0
    return a * math.cos(f * q) + b * math.sin(f * q)


@jit
def body_damping(p: Plant, body: int, v: float) -> float:
    """Return the damping of a body that the matrix of linear dampings leaves out [N m s/rad]."""
    if body == MOTOR:
        return (p.extra_m if v < 0.0 else 0.0) + p.drag_m * abs(v)
    if body == GEAR:
        return p.extra_g if v < 0.0 else 0.0
    return (p.extra_l if v < 0.0 else 0.0) + p.drag_l * abs(v)


@jit
def shaking(p: Plant, amplitude: float, t: float) -> float:
    """Return the torque of an external vibration."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * math.sin(p.shake_f * t + p.shake_phase)


@jit
def weight(p: Plant, q_l: float) -> float:
    """Return the torque of the load's weight on the load."""
    return -p.m_g_l * math.sin(q_l - p.q_0) if p.m_g_l != 0.0 else 0.0


@jit
def outer_torque(p: Plant, x: Floats, body: int, t: float, torque: float) -> float:
    """Return the torque on a body from everything but its neighbours and its dry friction."""
    v = x[V + body]
    total = -body_damping(p, body, v) * v - bristle_level(p, body) * x[BRISTLE + body] / p.z_s
    if body == MOTOR:
        total += motor_torque(p, x) + p.torque_offset - p.d_m * v
        total += ripple(p.cog_a, p.cog_b, p.cog_f, x[Q])
        total += ripple(p.mesh_a, p.mesh_b, p.mesh_f, x[Q]) * torque
        total += shaking(p, p.shake_m, t)
    elif body == GEAR:
        total -= p.d_g * v
    else:
        total += shaking(p, p.shake_l, t) + weight(p, x[Q + LOAD]) - p.d_l * v
    return float(total)


@jit
def warming_rate(p: Plant, v_m: float) -> float:
    """Return the rate at which the motor's friction warms up [1/s]."""
    return 1.0 / p.cold_time + abs(v_m) / p.cold_travel


@jit
def mount_torque(p: Plant, x: Floats, body: int) -> float:
    """Return the torque of the flexible mount on the body that it is attached to."""
    return float(p.k_f * (x[Q + 3] - x[Q + body]) + p.d_f * (x[V + 3] - x[V + body]))


def selection(leads: tuple[int, ...]) -> Floats:
    """Return the matrix S of q = S z (+ held bodies), shape (4, coordinates)."""
    free = sorted({lead for lead in leads if lead >= 0})
    matrix = np.zeros((4, len(free)))
    for body, lead in enumerate(leads):
        if lead >= 0:
            matrix[body, free.index(lead)] = 1.0
    return matrix


def inertias(p: Plant) -> Floats:
    """Return the inertias of motor, gear, load and mount as a diagonal matrix, shape (4, 4)."""
    return np.diag([p.I_m, p.I_g, p.I_l, p.I_f])


def dampings(p: Plant, attach: int, gear: bool, bar: bool) -> Floats:
    """Return the matrix of linear dampings, shape (4, 4)."""
    matrix = np.diag([p.d_m, p.d_g, p.d_l, 0.0])
    between = ((MOTOR, GEAR, p.d_mg * gear), (GEAR, LOAD, p.d_gl * bar), (attach, 3, p.d_f))
    for one, other, d in between:
        matrix[one, one] += d
        matrix[other, other] += d
        matrix[one, other] -= d
        matrix[other, one] -= d
    return matrix
