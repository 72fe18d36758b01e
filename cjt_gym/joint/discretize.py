"""Exact discretisation of many joints at once, inside compiled code.

The same zero-order hold as `linear.zero_order_hold`, by scaling and squaring of a Taylor
series in a state scaled by the step, [z, h dz, q_l], which keeps every entry near one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.compiled import compiled

Matrix = NDArray[np.float64]
TERMS = 18


@compiled
def expm_small(m: Matrix) -> Matrix:
    """Return the matrix exponential by a Taylor series of order 18, scaled and squared.

    The truncation error after scaling to a norm below 1/2 is under 1e-22.
    """
    n = m.shape[0]
    norm = 0.0
    for j in range(n):
        column = 0.0
        for i in range(n):
            column += abs(m[i, j])
        norm = max(norm, column)
    squarings = 0
    while norm > 0.5:
        norm *= 0.5
        squarings += 1
    scaled = m * 0.5**squarings
    result = np.eye(n)
    term = np.eye(n)
    for k in range(1, TERMS + 1):
        term = (term @ scaled) / k
        result += term
    for _ in range(squarings):
        result = result @ result
    return result


@compiled
def discretize(p: Any, groups: tuple[int, int, int], h: float, a: Matrix, b: Matrix) -> None:
    """Write the discrete A and B of one joint for a step h [s].

    Args:
        p: Parameter record.
        groups: Coordinate of motor, gear and load; -1 for a prescribed load.
        h: Step [s].
        a: Result, shape (order, order).
        b: Result, shape (order, 2 + size): motor torque, load input, torque per coordinate.
    """
    order, size = a.shape[0], b.shape[1] - 2
    fixed = groups[2] < 0
    velocity = order - size
    mass = np.zeros(3)
    mass[groups[0]] += p.I_m
    mass[groups[1]] += p.I_g
    if not fixed:
        mass[groups[2]] += p.I_l
    inputs = 2 + size
    m = np.zeros((order + inputs, order + inputs))
    for g in range(size):
        m[g, velocity + g] = 1.0
        m[velocity + g, order + 2 + g] = h * h / mass[g]
    m[velocity + groups[0], order] = h * h / mass[groups[0]]
    if fixed:
        m[size, order + 1] = h
    else:
        m[velocity + groups[2], order + 1] = h * h / mass[groups[2]]
    _ground(m, velocity + groups[0], p.d_m * h / mass[groups[0]])
    _ground(m, velocity + groups[1], p.d_g * h / mass[groups[1]])
    if not fixed:
        _ground(m, velocity + groups[2], p.d_l * h / mass[groups[2]])
    _spring(m, groups[0], groups[1], velocity, size, order, mass, p.k_g, p.d_mg, h)
    _spring(m, groups[1], groups[2], velocity, size, order, mass, p.k_b, p.d_gl, h)
    exact = expm_small(m)
    for i in range(order):
        row = 1.0 / h if i >= velocity else 1.0
        for j in range(order):
            a[i, j] = exact[i, j] * row * (h if j >= velocity else 1.0)
        for j in range(inputs):
            b[i, j] = exact[i, order + j] * row


@compiled
def _ground(m: Matrix, row: int, rate: float) -> None:
    m[row, row] -= rate


@compiled
def _spring(
    m: Matrix,
    one: int,
    other: int,
    velocity: int,
    size: int,
    order: int,
    mass: NDArray[np.float64],
    k: float,
    d: float,
    h: float,
) -> None:
    """Add a spring and damper between two coordinates; -1 is the prescribed load."""
    if one == other:
        return
    for here, there in ((one, other), (other, one)):
        if here < 0:
            continue
        stiff, damp = k * h * h / mass[here], d * h / mass[here]
        m[velocity + here, here] -= stiff
        m[velocity + here, velocity + here] -= damp
        if there >= 0:
            m[velocity + here, there] += stiff
            m[velocity + here, velocity + there] += damp
        else:
            m[velocity + here, size] += stiff
            m[velocity + here, order + 1] += damp * h
