"""The one-step predictor: a linear system, a constant gain, and friction that may stick.

Friction is solved implicitly over the sample, so that a body which friction can hold comes to rest
exactly (set-valued law): v+ = v_free - clip(v_free, -g F-, g F+), with g the velocity that one
newton metre adds over the sample. Smooth and elastic (Dahl) laws are solved implicitly as well.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.compiled import compiled

Floats = NDArray[np.float64]

LEVEL_P, LEVEL_N, EXTRA_P, EXTRA_N, SPEED, VISCOUS_N, ELASTIC, LOADED, SMOOTH = range(9)
"""Columns of a friction law: Coulomb levels for both directions [N m], what breakaway adds to them
[N m], Stribeck velocity [rad/s], damping added at negative velocity [N m s/rad], presliding
displacement [rad], friction per transmitted torque [-], smoothing velocity [rad/s]."""
LAW_SIZE = 9


@compiled
def level(law: Floats, side: float, speed: float, load: float) -> float:
    """Return the friction level [N m] on one side of zero at a speed [rad/s]."""
    base, extra = law[LEVEL_P], law[EXTRA_P]
    if side < 0.0:
        base, extra = law[LEVEL_N], law[EXTRA_N]
    if extra != 0.0 and law[SPEED] > 0.0:
        base += extra * math.exp(-((speed / law[SPEED]) ** 2))
    return max(base + law[LOADED] * load, 0.0)


@compiled
def smooth_speed(free: float, gain: float, force: float, width: float) -> float:
    """Solve v + gain * force * tanh(v / width) = free for v by Newton's method."""
    v = free / (1.0 + gain * force / width)
    for _ in range(12):
        t = math.tanh(v / width)
        step = (v + gain * force * t - free) / (1.0 + gain * force / width * (1.0 - t * t))
        v -= max(min(step, 2.0 * width + 0.5 * abs(v)), -2.0 * width - 0.5 * abs(v))
        if abs(step) < 1e-9 * (abs(v) + width):
            break
    return v


@compiled
def elastic_speed(free: float, gain: float, force: float, z: float, width: float, h: float) -> float:
    """Solve the implicit Dahl step v + gain z+(v) = free for v.

    z+ = (z + force h v / width) / (1 + h |v| / width), the bristle's torque at the end.
    """
    excess = free - gain * z
    side = 1.0 if excess >= 0.0 else -1.0
    a = h / width
    w, f, y = 1.0, side * free, side * z
    # (w - f)(1 + a w) + gain (y + force a w) = 0 for the speed w >= 0
    b = 1.0 - a * f + gain * force * a
    c = gain * y - f
    w = (-b + math.sqrt(max(b * b - 4.0 * a * c, 0.0))) / (2.0 * a)
    return side * max(w, 0.0)


@compiled
def friction_torque(
    law: Floats, free: float, gain: float, load: float, h: float, bristle: float
) -> tuple[float, float]:
    """Return the torque [N m] that friction adds over a sample, and the bristle's new torque.

    Args:
        law: Friction law, shape (9,).
        free: Velocity at the end of the sample without friction [rad/s].
        gain: Velocity that one newton metre adds over the sample [rad/(s N m)].
        load: Size of the transmitted torque [N m].
        h: Sample time [s].
        bristle: Torque of the elastic bristle [N m].
    """
    side = 1.0 if free >= 0.0 else -1.0
    damping = law[VISCOUS_N] if side < 0.0 else 0.0
    shrink = 1.0 / (1.0 + gain * damping)
    v_free, g = free * shrink, gain * shrink
    if law[ELASTIC] > 0.0:
        towards = 1.0 if v_free >= g * bristle else -1.0
        force = level(law, towards, abs(v_free), load)
        if force <= 0.0:
            return (v_free - free) / gain, 0.0
        v = elastic_speed(v_free, g, force, bristle, law[ELASTIC], h)
        a = h / law[ELASTIC]
        return (v - free) / gain, (bristle + force * a * v) / (1.0 + a * abs(v))
    hold = level(law, side, 0.0, load)
    if law[SMOOTH] > 0.0:
        force = level(law, side, abs(v_free), load)
        return (smooth_speed(v_free, g, force, law[SMOOTH]) - free) / gain, 0.0
    if abs(v_free) <= g * hold:
        return -free / gain, 0.0
    v = abs(v_free)
    for _ in range(3):
        v = max(abs(v_free) - g * level(law, side, v, load), 0.0)
    return (side * v - free) / gain, 0.0


@compiled
def predict(
    a: Floats,
    g: Floats,
    k: Floats,
    forced: Floats,
    outputs: NDArray[np.int64],
    y: Floats,
    valid: NDArray[np.bool_],
    x0: Floats,
    laws: Floats,
    bodies: NDArray[np.int64],
    load: Floats,
    h: float,
) -> tuple[Floats, Floats, Floats]:
    """Run the predictor over a record.

    Args:
        a: Transition matrix over one sample, shape (n, n).
        g: Effect of a torque held over the sample on each friction body, shape (n, bodies).
        k: Predictor gain, shape (n, m).
        forced: What the known inputs add over each sample, shape (N, n).
        outputs: Index of the state that each output measures, shape (m,).
        y: Measured outputs, shape (N, m).
        valid: Whether the sample was measured, shape (N,).
        x0: State at the first sample, shape (n,).
        laws: Friction laws, shape (bodies, 9).
        bodies: Index of each body's velocity in the state, shape (bodies,).
        load: Size of the transmitted torque at each sample [N m], shape (N,).
        h: Sample time [s].

    Returns:
        Innovations, shape (N, m); predicted states, shape (N, n); friction torque on each body over
        each sample [N m], shape (N, bodies).
    """
    n, m, nb = a.shape[0], outputs.shape[0], bodies.shape[0]
    size = forced.shape[0]
    e = np.zeros((size, m))
    states = np.zeros((size, n))
    torque = np.zeros((size, nb))
    bristle = np.zeros(nb)
    x = x0.copy()
    new = np.zeros(n)
    for t in range(size):
        states[t] = x
        if valid[t]:
            for j in range(m):
                e[t, j] = y[t, j] - x[outputs[j]]
            for j in range(m):
                for i in range(n):
                    x[i] += k[i, j] * e[t, j]
        for i in range(n):
            value = forced[t, i]
            for j in range(n):
                value += a[i, j] * x[j]
            new[i] = value
        for sweep in range(1 if nb < 2 else 3):
            for b in range(nb):
                row = bodies[b]
                before = torque[t, b] if sweep else 0.0
                free = new[row] - g[row, b] * before
                lam, z = friction_torque(laws[b], free, g[row, b], load[t], h, bristle[b])
                for i in range(n):
                    new[i] += g[i, b] * (lam - before)
                torque[t, b] = lam
                if sweep == (0 if nb < 2 else 2):
                    bristle[b] = z
        for i in range(n):
            x[i] = new[i]
    return e, states, torque
