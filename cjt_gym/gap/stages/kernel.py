"""The one-step predictor: a linear system, a constant gain, and friction that may stick.

Friction is solved implicitly over the sample, so that a body which friction can hold comes to rest
exactly (set-valued law): v+ = v_free - clip(v_free, -g F-, g F+), with g the velocity that one
newton metre adds over the sample. If the body reverses within the sample, so does friction: the
sample is split at zero velocity. Smooth and elastic (Dahl) laws are also solved implicitly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import lean, threaded

LEVEL_P, LEVEL_N, EXTRA_P, EXTRA_N, SPEED, VISCOUS_P, VISCOUS_N, ELASTIC, LOADED, SMOOTH = range(10)
"""Columns of a friction law: Coulomb levels for both directions [N m], breakaway levels above them
[N m], Stribeck velocity [rad/s], damping added at positive and negative velocity [N m s/rad],
presliding displacement [rad], friction per transmitted torque [-], smoothing velocity [rad/s]."""


class Linear(NamedTuple):
    """A linear system over the samples of a record.

    Attributes:
        a: Transition matrix over one sample, shape (n, n).
        torque: Effect of a torque held over the sample on each friction body, shape (n, bodies).
        forced: Contribution of the known inputs over each sample, shape (N, n).
        x0: State at the first sample, shape (n,).
        h: Sample time [s].
    """

    a: Floats
    torque: Floats
    forced: Floats
    x0: Floats
    h: float


class Measured(NamedTuple):
    """What was measured of its first state.

    Attributes:
        gain: Predictor gain, shape (n,).
        y: Measured values, shape (N,).
        valid: Whether the sample was measured, shape (N,).
    """

    gain: Floats
    y: Floats
    valid: NDArray[np.bool_]


class Rubbing(NamedTuple):
    """Friction of its bodies.

    Attributes:
        laws: Friction laws, shape (bodies, 10).
        bodies: Index of each body's velocity in the state, shape (bodies,).
        load: Friction on each body beside its law [N m], shape (N, bodies).
    """

    laws: Floats
    bodies: NDArray[np.int64]
    load: Floats


class Found(NamedTuple):
    """What it predicts; zeros at first.

    Attributes:
        e: Innovations, shape (N,).
        states: Predicted states, shape (N, n).
        torque: Friction torque on each body over each sample [N m], shape (N, bodies).
        bristle: Torque of each body's elastic bristle at the end [N m], shape (bodies,).
        slack: Motion that each body lost in the last sample [rad], shape (bodies,).
    """

    e: Floats
    states: Floats
    torque: Floats
    bristle: Floats
    slack: Floats


class Backlash(NamedTuple):
    """Backlash in its gear; arrays of no size where there is none.

    Attributes:
        play: Shape (3 + 2 n,): half its width [rad], then the signs with which the state enters
            the gear's deflection, then the contribution of the gear's spring to the state at a
            deflection of half the width, then the gear's stiffness [N m/rad] and the part of its
            damping that keeps the teeth from pulling [N m s/rad].
        a: Transition matrix while the teeth do not touch, shape (n, n).
        forced: `Linear.forced` meanwhile, shape (N, n).
        torque: `Linear.torque` meanwhile, shape (n, bodies).
        entry: Prescribed part of the gear's deflection [rad], shape (N,), or (0,).
    """

    play: Floats
    a: Floats
    forced: Floats
    torque: Floats
    entry: Floats


@lean
def level(law: Floats, side: float, speed: float, load: float) -> float:
    """Return the friction level [N m] at a speed [rad/s] on one side of zero, `load` included."""
    base, extra = law[LEVEL_P], law[EXTRA_P]
    if side < 0.0:
        base, extra = law[LEVEL_N], law[EXTRA_N]
    if extra != 0.0 and law[SPEED] > 0.0:
        base += extra * math.exp(-((speed / law[SPEED]) ** 2))
    return float(max(base + load, 0.0))


@lean
def smooth_speed(start: float, free: float, gain: float, force: float, width: float) -> float:
    """Solve v + gain * force * tanh(m / width) = free for v by Newton's method between bounds.

    The law acts at m = start + share * (v - start). The share makes a step exact for a linear law:
    1/2 if the law is soft over the sample, 1 if it is stiff.
    """
    stiff = gain * force / width
    share = 0.5 + stiff / 12.0 if stiff < 1e-3 else 1.0 / (1.0 - math.exp(-stiff)) - 1.0 / stiff
    low, high = free - gain * force, free + gain * force
    v = (free - stiff * (1.0 - share) * start) / (1.0 + stiff * share)
    for _ in range(60):
        t = math.tanh((start + share * (v - start)) / width)
        left = v + gain * force * t - free
        if left > 0.0:
            high = v
        else:
            low = v
        new = v - left / (1.0 + share * stiff * (1.0 - t * t))
        if not low < new < high:
            new = 0.5 * (low + high)
        step, v = new - v, new
        if abs(step) < 1e-9 * (abs(v) + width):
            break
    return v


@lean
def elastic_step(
    start: float, free: float, gain: float, force: float, z: float, width: float, h: float
) -> tuple[float, float]:
    """Solve a step of Dahl's bristle; return the velocity at its end and the bristle's new torque.

    z+ = (z + force x / width) / (1 + |x| / width) after a motion x = h (start + end) / 2, and the
    mean of z and z+ acts over the step. The motion in units of the width is the positive root of a
    quadratic.
    """
    total = start + free
    side = 1.0 if total >= gain * z else -1.0
    v, y, c = side * total, side * z, 2.0 * width / h
    b = c - v + 0.5 * gain * (y + force)
    u = (-b + math.sqrt(max(b * b + 4.0 * c * (v - gain * y), 0.0))) / (2.0 * c)
    u = max(u, 0.0)
    new = (y + force * u) / (1.0 + u)
    return free - 0.5 * gain * side * (y + new), side * new


@lean
def turning(
    law: Floats, start: float, free: float, gain: float, load: float, h: float
) -> tuple[float, float]:
    """Return end velocity and lost motion [rad] of a body that stops within the sample.

    Args:
        law: Friction law, shape (10,).
        start: Velocity at the start [rad/s].
        free: Velocity at the end without friction [rad/s].
        gain: Velocity that one newton metre adds over the sample.
        load: Friction beside the law [N m].
        h: Sample time [s].
    """
    side = 1.0 if start >= 0.0 else -1.0
    push = free - start
    slowing = push - side * gain * level(law, side, abs(start), load)
    share = 0.0 if slowing == 0.0 else min(max(-start / slowing, 0.0), 1.0)
    side = 1.0 if push >= 0.0 else -1.0
    rest = abs(push) - gain * level(law, side, 0.0, load)
    if rest > 0.0:
        rest = max(abs(push) - gain * level(law, side, 0.5 * rest, load), 0.0)
    end = side * max(rest, 0.0) * (1.0 - share)
    return end, 0.5 * h * (start * share + end * (1.0 - share) - start - end)


@lean
def friction_torque(
    law: Floats, start: float, free: float, gain: float, load: float, h: float, bristle: float
) -> tuple[float, float, float]:
    """Return the effect of friction over a sample.

    The three values are the torque that it adds [N m], the bristle's new torque [N m], and the
    difference in motion [rad] from that under a constant torque.

    Args:
        law: Friction law, shape (10,).
        start: Velocity at the start [rad/s].
        free: Velocity at the end of the sample without friction [rad/s].
        gain: Velocity that one newton metre adds over the sample [rad/(s N m)].
        load: Friction beside the law [N m].
        h: Sample time [s].
        bristle: Torque of the elastic bristle [N m].
    """
    side = 1.0 if free >= 0.0 else -1.0
    damping = law[VISCOUS_P] if side > 0.0 else law[VISCOUS_N]
    shrink = 1.0 / (1.0 + 0.5 * gain * damping)
    v_free, g = shrink * (free - 0.5 * gain * damping * start), gain * shrink
    if law[ELASTIC] > 0.0:
        towards = 1.0 if v_free >= g * bristle else -1.0
        force = level(law, towards, abs(v_free), load)
        if force <= 0.0:
            return (v_free - free) / gain, 0.0, 0.0
        v, z = elastic_step(start, v_free, g, force, bristle, law[ELASTIC], h)
        return (v - free) / gain, z, 0.0
    if law[SMOOTH] > 0.0:
        force = max(level(law, side, abs(v_free), load), 1e-300)
        return (smooth_speed(start, v_free, g, force, law[SMOOTH]) - free) / gain, 0.0, 0.0
    v, lost = 0.0, 0.0
    moved = abs(v_free) - g * level(law, side, 0.5 * abs(start + v_free), load)
    if start * side > 0.0 and moved > 0.0:
        v = side * moved
        for _ in range(2):
            middle = 0.5 * abs(start + v)
            v = side * max(abs(v_free) - g * level(law, side, middle, load), 0.0)
    else:
        v, lost = turning(law, start, v_free, g, load, h)
    return (v - free) / gain, 0.0, lost


@lean
def pushing(start: float, end: float, torque: float, after: float, half: float) -> float:
    """Return the share of a sample in which the teeth of a gear push each other.

    Teeth in contact push while spring and damper together do; they never pull.

    Args:
        start: Deflection of the gear at the start, positive on the side considered [rad].
        end: Deflection at the end if the contact state remained that of the start [rad].
        torque: Pushing torque of spring and damper at the start [N m].
        after: The same at the end [N m].
        half: Half the play [rad].
    """
    if start >= half and torque > 0.0:
        return 1.0 if after >= 0.0 else torque / (torque - after)
    if start >= half:
        return 0.0 if after <= 0.0 or end < half else after / (after - torque)
    return 0.0 if end <= half else (end - half) / max(end - start, 1e-15)


@lean
def pass_through(gap: Backlash, x: Floats, new: Floats, free: Floats, t: int, h: float) -> float:
    """Correct the new state, computed for a gear in contact, for play; return the contact share.

    Args:
        gap: The play.
        x: State, shape (n,).
        new: State at the end of the sample, shape (n,).
        free: Scratch, shape (n,).
        t: The sample.
        h: Sample time [s].
    """
    play, entry = gap.play, gap.entry
    n, half = x.size, play[0]
    stiffness, damping = play[1 + 2 * n], play[2 + 2 * n]
    start = touch = apart = 0.0
    rate = touch_rate = apart_rate = 0.0
    for i in range(n):
        value = gap.forced[t, i]
        for j in range(n):
            value += gap.a[i, j] * x[j]
        free[i] = value
    for i in range(n // 2):
        sign = play[1 + i]
        start += sign * x[i]
        touch += sign * new[i]
        apart += sign * free[i]
        rate += sign * x[i + n // 2]
        touch_rate += sign * new[i + n // 2]
        apart_rate += sign * free[i + n // 2]
    if entry.size > 0:
        after = entry[min(t + 1, entry.size - 1)]
        moving = (after - entry[t]) / h
        start, touch, apart = start + entry[t], touch + after, apart + after
        rate, touch_rate, apart_rate = rate + moving, touch_rate + moving, apart_rate + moving
    if abs(start) >= half:
        side = 1.0 if start > 0.0 else -1.0
        push = stiffness * (side * start - half) + damping * side * rate
        end, end_rate = apart, apart_rate
        if push > 0.0:
            end, end_rate = touch, touch_rate
            for i in range(n // 2):
                end += side * play[1 + i] * play[1 + n + i]
                end_rate += side * play[1 + i] * play[1 + n + i + n // 2]
    else:
        side = 1.0 if apart > 0.0 else -1.0
        push, end, end_rate = 0.0, apart, apart_rate
    last = stiffness * (side * end - half) + damping * side * end_rate
    share = pushing(side * start, side * end, push, last, half)
    for i in range(n):
        touched = new[i] + side * play[1 + n + i]
        new[i] = share * touched + (1.0 - share) * free[i]
    return share


@threaded
def predict(
    system: Linear, measured: Measured, rubbing: Rubbing, gap: Backlash, found: Found, work: Floats
) -> None:
    """Run the predictor over a record.

    Args:
        system: The linear system.
        measured: What was measured of it.
        rubbing: Its friction.
        gap: Its play.
        found: Receives what it predicts.
        work: Scratch, shape (3 + bodies, n) or larger.
    """
    a, firm, forced, x0, h = system
    k, y, valid = measured
    laws, bodies, load = rubbing
    e, states, torque, bristle, slack = found
    x, new, free, g = work[0], work[1], work[2], work[3:].T
    n, nb = a.shape[0], bodies.shape[0]
    size = forced.shape[0]
    for i in range(n):
        x[i] = x0[i]
        for b in range(nb):
            g[i, b] = firm[i, b]
    for t in range(size):
        for i in range(n):
            states[t, i] = x[i]
        if valid[t]:
            e[t] = y[t] - x[0]
            for i in range(n):
                x[i] += k[i] * e[t]
        for i in range(n):
            value = forced[t, i]
            for j in range(n):
                value += a[i, j] * x[j]
            new[i] = value
        if gap.play.size > 0:
            share = pass_through(gap, x, new, free, t, h)
            for i in range(n):
                for b in range(nb):
                    g[i, b] = share * firm[i, b] + (1.0 - share) * gap.torque[i, b]
        for sweep in range(1 if nb < 2 else 3):
            for b in range(nb):
                row = bodies[b]
                before = torque[t, b] if sweep else 0.0
                alone = new[row] - g[row, b] * before
                lam, z, lost = friction_torque(
                    laws[b], x[row], alone, g[row, b], load[t, b], h, bristle[b]
                )
                for i in range(n):
                    new[i] += g[i, b] * (lam - before)
                new[row - n // 2] += lost - slack[b] if sweep else lost
                slack[b] = lost
                torque[t, b] = lam
                if sweep == (0 if nb < 2 else 2):
                    bristle[b] = z
        for i in range(n):
            x[i] = new[i]
