"""The fine-step integrator: drift, kick, drift, with set-valued friction in the kick.

Half a step of motion at constant velocity, then the velocities under the torques at the middle,

    (M + h/2 D) (v+ - v) = h (f - D v - friction),      friction in F(v+),

then the other half. Elastic torques are explicit and symmetric, linear damping is trapezoidal, and
friction is implicit: a body whose momentum friction can take up ends its step at rest. Bodies that
move together and bodies that are held need no case of their own: the inverse of M + h/2 D over the
free coordinates is spread over all four bodies, and is zero where nothing moves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cjt_gym.blind.compiled import jit
from cjt_gym.blind.laws import (
    bar_torque,
    beyond,
    drag_bristles,
    friction_levels,
    half_play,
    mount_torque,
    outer_torque,
    twist_memories,
    warming_rate,
)
from cjt_gym.blind.plant import GEAR, LOAD, MOTOR, MOUNT, Drive, Floats, Ints, Plant
from cjt_gym.blind.state import BAR, CREEP, CURRENT, HEAT, SLEWED, TAU, WARM, Q, V

SWEEPS = 4
"""Passes over the bodies with friction, which dampers couple only weakly within a fine step."""
OPEN, CLOSED = 0, 1
"""Index of a mobility: with the contact of the play open or closed."""
FORCE, UP, DOWN, TAKEN = 0, 1, 2, 3
"""Rows of the scratch array: torques, largest friction impulses, and the impulses taken."""


@jit
def reference_current(d: Drive, command: float) -> float:
    """Return the reference of the current loop: rounded, after dead zone and limit [A]."""
    value = command
    if d.resolution > 0.0:
        value = d.resolution * math.floor(value / d.resolution + 0.5)
    if d.dead > 0.0:
        value = math.copysign(max(abs(value) - d.dead, 0.0), value)
    return min(max(value, -d.i_max), d.i_max)


@jit
def advance_current(d: Drive, x: Floats, command: float, h: float) -> None:
    """Advance the current by h in place: slew limit, then a first-order lag, exact for a step."""
    target = reference_current(d, command)
    change = min(max(target - x[SLEWED], -d.slew * h), d.slew * h)
    x[SLEWED] += change
    decay = math.exp(-2.0 * math.pi * d.bandwidth * h)
    x[CURRENT] = x[SLEWED] + (x[CURRENT] - x[SLEWED]) * decay


@jit
def mobility(mass: Floats, damping: Floats, s: Floats, h: float) -> Floats:
    """Return S (S'(M + h/2 D) S)^-1 S', shape (4, 4) [rad/s per N m s]."""
    reduced = s.T @ (mass + 0.5 * h * damping) @ s
    return s @ np.linalg.inv(reduced) @ s.T


@jit
def in_contact(half: float, twist: float, torque: float) -> bool:
    """Return whether a spring with play is in contact; `torque` includes damping as if it were."""
    if half <= 0.0:
        return True
    if twist > half:
        return torque > 0.0
    return twist < -half and torque < 0.0


@jit
def follow_bar(p: Plant, x: Floats, half: float) -> float:
    """Update the memories of the bar to its present twist, in place; return that twist [rad]."""
    twist = beyond(x[Q + GEAR] - x[Q + LOAD], half)
    twist_memories(p, x, twist - x[BAR])
    x[BAR] = twist
    return twist


@jit
def gear_torque(p: Plant, x: Floats, half: float) -> tuple[float, bool]:
    """Return the torque of a compliant gearbox with its damping, and whether its teeth touch."""
    twist = x[Q + MOTOR] - x[Q + GEAR]
    torque = p.k_g * beyond(twist, half) + p.d_mg * (x[V + MOTOR] - x[V + GEAR])
    touches = in_contact(half, twist, torque)
    return (torque if touches else 0.0), touches


@jit
def sensed_torque(p: Plant, leads: Ints, x: Floats) -> tuple[float, bool]:
    """Update the memories of the bar; return its torque and whether it is in contact."""
    if leads[LOAD] == leads[GEAR]:
        return x[TAU], True
    half = half_play(p, x[Q]) if leads[GEAR] == leads[MOTOR] else 0.0
    twist = follow_bar(p, x, half)
    torque = bar_torque(p, x, twist) + p.d_gl * (x[V + GEAR] - x[V + LOAD])
    touches = in_contact(half, x[Q + GEAR] - x[Q + LOAD], torque)
    return (torque if touches else 0.0), touches


@jit
def rub(p: Plant, leads: Ints, x: Floats, w: Floats, torque: float, h: float, work: Floats) -> None:
    """Apply dry friction to the velocities, in place: v+ = v_free - W r, r in h F(v+).

    The levels of bodies that move together are added on the leading one. Row TAKEN of `work`, shape
    (4, 4), receives the impulse of each body [N m s].
    """
    for body in range(3):
        work[UP, body], work[DOWN, body], work[TAKEN, body] = 0.0, 0.0, 0.0
    rubbing = 0
    for body in range(3):
        if leads[body] >= 0:
            up, down = friction_levels(p, body, x[V + body], torque, x[Q], x[WARM])
            if up + down > 0.0:
                work[UP, leads[body]] += h * up
                work[DOWN, leads[body]] += h * down
                rubbing += 1
    if rubbing == 0:
        return
    for _ in range(SWEEPS if rubbing > 1 else 1):
        for body in range(3):
            up, down, taken = work[UP, body], work[DOWN, body], work[TAKEN, body]
            if up + down > 0.0:
                total = min(max(taken + x[V + body] / w[body, body], -down), up)
                for other in range(4):
                    x[V + other] -= w[other, body] * (total - taken)
                work[TAKEN, body] = total
                if -down < total < up:
                    x[V + body] = 0.0
    for body in range(4):
        if leads[body] >= 0:
            x[V + body] = x[V + leads[body]]


@jit
def advance_memories(p: Plant, x: Floats, h: float) -> None:
    """Advance the slow states in place: heat of the winding, warming up, creep."""
    if p.heat_loss > 0.0:
        x[HEAT] += (x[CURRENT] ** 2 - x[HEAT]) * (1.0 - math.exp(-h / p.heat_time))
    if p.cold > 0.0:
        x[WARM] += h * warming_rate(p, x[V])
    if p.creep > 0.0:
        rate = (p.creep * x[BAR] - x[CREEP]) / p.creep_time
        x[CREEP] += h * rate


class Moving(NamedTuple):
    """A joint as it moves in steps of one length.

    Attributes:
        plant: Plant.
        drive: Drive.
        leads: The body whose motion each body shares, shape (4,).
        attach: Body that the mount is attached to.
        w: Mobilities with open and with closed contact, shape (2, 4, 4).
        work: Scratch, shape (4, 4).
    """

    plant: Plant
    drive: Drive
    leads: Ints
    attach: int
    w: Floats
    work: Floats


@jit
def step(joint: Moving, x: Floats, command: float, noise: float, t: float, h: float) -> float:
    """Advance one joint by h in place; return the torque of its bar at the middle of the step.

    Args:
        joint: The joint.
        x: State, shape (SIZE,).
        command: Command of the drive [A].
        noise: Torque on the motor [N m].
        t: Time at the start [s].
        h: Step [s].
    """
    p, d, leads, attach, w, work = joint
    advance_current(d, x, command, 0.5 * h)
    for body in range(4):
        x[Q + body] += 0.5 * h * x[V + body]
    drag_bristles(p, x)
    tau, touches = sensed_torque(p, leads, x)
    force = work[FORCE]
    force[MOUNT] = 0.0
    for body in range(3):
        force[body] = outer_torque(p, x, body, t + 0.5 * h, tau)
    force[MOTOR] += noise
    if p.k_f > 0.0:
        pull = mount_torque(p, x, attach)
        force[attach] += pull
        force[MOUNT] -= pull
    on_load = force[LOAD]
    if leads[GEAR] != leads[MOTOR]:
        mesh, touches = gear_torque(p, x, half_play(p, x[Q]))
        force[MOTOR] -= mesh
        force[GEAR] += mesh
    if leads[LOAD] != leads[GEAR]:
        force[GEAR] -= tau
        force[LOAD] += tau
    inverse = w[CLOSED] if touches else w[OPEN]
    before = x[V + LOAD]
    for body in range(4):
        for other in range(4):
            x[V + body] += h * inverse[body, other] * force[other]
    rub(p, leads, x, inverse, tau, h, work)
    if leads[LOAD] == leads[MOTOR]:
        x[TAU] = rigid_torque(p, x, on_load, (x[V + LOAD] - before) / h, work[TAKEN, MOTOR] / h)
    advance_memories(p, x, h)
    for body in range(4):
        x[Q + body] += 0.5 * h * x[V + body]
    advance_current(d, x, command, 0.5 * h)
    return tau


@jit
def rigid_torque(p: Plant, x: Floats, on_load: float, a: float, friction: float) -> float:
    """Return the torque between gear and load of a rigid joint, I_l a - (torques on the load).

    The load takes its share of the dry friction of the whole.
    """
    share = 0.0
    total_up, total_down = 0.0, 0.0
    for body in range(3):
        up, down = friction_levels(p, body, x[V + body], x[TAU], x[Q], x[WARM])
        total_up, total_down = total_up + up, total_down + down
    up, down = friction_levels(p, LOAD, x[V + LOAD], x[TAU], x[Q], x[WARM])
    if friction > 0.0:
        share = up / total_up
    elif friction < 0.0:
        share = down / total_down
    return p.I_l * a - on_load + share * friction
