"""Exact discretisation of many joints at once, inside compiled code.

The same zero-order hold as `linear.zero_order_hold`, in a state scaled by the step, [z, q_l, h dz],
which keeps every entry near one. With X the scaled system matrix times the step,

    phi(X) = X^-1 (exp(X) - 1) = sum_k X^k / (k + 1)!,
    A = exp(X) = 1 + X phi(X),  B = phi(X) U,

so that one series of the size of the state gives both, for a small X. It stops when it has
converged, and is squared, exp(2 X) = exp(X)^2 and phi(2 X) = (exp(X) + 1) phi(X) / 2. The rows of
positions in X only select velocities: multiplying by X costs the rows of velocities alone.

References:
    Higham (2008), Functions of Matrices, chapter 10.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.compiled import apart, lean
from cjt_gym.joint.kernel.springs import BAR, has_play, linear_spring

Matrix = NDArray[np.float64]
MAX_ORDER = 6  # three bodies, each with an angle and a velocity
SCRATCH = (4, MAX_ORDER, MAX_ORDER)
LARGEST_NORM = 0.5
"""To which a matrix is halved before its series: with it the series ends within 20 terms."""
CONVERGED = 1e-20
"""Largest entry of a term that no longer changes a double."""
MAX_TERMS = 30
"""Of a series; never met, so that no loop is endless."""


@apart
def discretize(
    p: Any, groups: tuple[int, int, int], h: float, a: Matrix, b: Matrix, scratch: Matrix
) -> None:
    """Write the discrete A and B of one joint for a step h, with `scratch` of the shape `SCRATCH`.

    Columns of B: motor torque, load input, torque per coordinate; shape (order, 2 + size).
    """
    order, size = a.shape[0], b.shape[1] - 2
    velocity = order - size
    x, phi, one, other = scratch[0], scratch[1], scratch[2], scratch[3]
    _fill(p, groups, h, order, size, x)
    squarings = _scale(x, order)
    _series(x, order, size, phi, one, other)
    _advance(x, phi, order, size, one)
    for i in range(order):
        one[i, i] += 1.0
    for _ in range(squarings):
        _multiply(one, phi, order, other)
        for i in range(order):
            for j in range(order):
                phi[i, j] = 0.5 * (phi[i, j] + other[i, j])
        _multiply(one, one, order, other)
        one, other = other, one
    for i in range(order):
        row = 1.0 / h if i >= velocity else 1.0
        for j in range(order):
            a[i, j] = one[i, j] * row * (h if j >= velocity else 1.0)
    _inputs(p, groups, h, phi, b)


@lean
def _mass(p: Any, groups: tuple[int, int, int], g: int) -> float:
    mass = 0.0
    if groups[0] == g:
        mass += p.I_m
    if groups[1] == g:
        mass += p.I_g
    if groups[2] == g:
        mass += p.I_l
    return mass


@lean
def _fill(p: Any, groups: tuple[int, int, int], h: float, order: int, size: int, x: Matrix) -> None:
    """Write X."""
    x[:order, :order] = 0.0
    velocity = order - size
    for g in range(size):
        x[g, velocity + g] = 1.0
        rate = 0.0
        if groups[0] == g:
            rate += p.d_m
        if groups[1] == g:
            rate += p.d_g
        if groups[2] == g:
            rate += p.d_l
        x[velocity + g, velocity + g] = -rate * h / _mass(p, groups, g)
    for which in range(2):
        _spring(p, groups, which, h, velocity, size, x)


@lean
def _spring(
    p: Any, groups: tuple[int, int, int], which: int, h: float, velocity: int, size: int, x: Matrix
) -> None:
    """Add a spring and damper behind body `which`; q_l stands behind z where it is prescribed."""
    if groups[which] == groups[which + 1] or has_play(p, groups, which):
        return
    k, d = linear_spring(p, which)
    for side in range(2):
        here, there = groups[which + side], groups[which + 1 - side]
        if here < 0:
            continue
        mass = _mass(p, groups, here)
        stiff, damp = k * h * h / mass, d * h / mass
        x[velocity + here, here] -= stiff
        x[velocity + here, velocity + here] -= damp
        if there >= 0:
            x[velocity + here, there] += stiff
            x[velocity + here, velocity + there] += damp
        else:
            x[velocity + here, size] += stiff


@lean
def _scale(x: Matrix, order: int) -> int:
    """Halve X until its 1-norm is small, in place; return how often."""
    norm = 0.0
    for j in range(order):
        column = 0.0
        for i in range(order):
            column += abs(x[i, j])
        norm = max(norm, column)
    squarings, factor = 0, 1.0
    while norm * factor > LARGEST_NORM:
        factor *= 0.5
        squarings += 1
    for i in range(order):
        for j in range(order):
            x[i, j] *= factor
    return squarings


@lean
def _advance(x: Matrix, y: Matrix, order: int, size: int, out: Matrix) -> None:
    velocity = order - size
    for g in range(size):
        select, row = x[g, velocity + g], velocity + g
        for j in range(order):
            out[g, j] = select * y[row, j]
            out[row, j] = 0.0
        for k in range(order):
            entry = x[row, k]
            for j in range(order):
                out[row, j] += entry * y[k, j]
    if velocity > size:
        for j in range(order):
            out[size, j] = 0.0


@lean
def _multiply(x: Matrix, y: Matrix, order: int, out: Matrix) -> None:
    """Write the product of two matrices, shape (order, order)."""
    for i in range(order):
        for j in range(order):
            out[i, j] = 0.0
        for k in range(order):
            entry = x[i, k]
            for j in range(order):
                out[i, j] += entry * y[k, j]


@lean
def _series(x: Matrix, order: int, size: int, phi: Matrix, term: Matrix, product: Matrix) -> None:
    """Write phi(X) by its Taylor series, up to the term that no longer counts."""
    for i in range(order):
        for j in range(order):
            phi[i, j] = term[i, j] = 1.0 if i == j else 0.0
    for k in range(2, MAX_TERMS):
        _advance(x, term, order, size, product)
        largest = 0.0
        for i in range(order):
            for j in range(order):
                value = product[i, j] / k
                term[i, j] = value
                phi[i, j] += value
                largest = max(largest, abs(value))
        if largest < CONVERGED:
            return


@lean
def _inputs(p: Any, groups: tuple[int, int, int], h: float, phi: Matrix, b: Matrix) -> None:
    """Write B from phi(X)."""
    order, size = b.shape[0], b.shape[1] - 2
    velocity = order - size
    for i in range(order):
        row = 1.0 / h if i >= velocity else 1.0
        for g in range(size):
            b[i, 2 + g] = phi[i, velocity + g] * row * h * h / _mass(p, groups, g)
        b[i, 0] = b[i, 2 + groups[0]]
        if groups[2] >= 0:
            b[i, 1] = b[i, 2 + groups[2]]
        else:
            b[i, 1] = phi[i, size] * row * h
            if not has_play(p, groups, BAR):
                b[i, 1] += p.d_gl * b[i, 2 + groups[1]]
