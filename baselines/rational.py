"""Transfer functions by their zeros, poles and gain, and the filters that invert them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import eigvals, matrix_balance

from cjt_gym.baselines.controller import Floats
from cjt_gym.baselines.pbh import root_text
from cjt_gym.errors import ConfigurationError
from cjt_gym.joint.kernel.arrays import Complex

StateSpace = tuple[Floats, Floats, Floats, float]
NOTHING = 1e-9
"""Relative size of what is zero but for rounding: a gain, or the real part of a zero."""


@dataclass(frozen=True)
class Rational:
    """A continuous transfer function gain * prod(s - zeros) / prod(s - poles)."""

    zeros: Complex
    poles: Complex
    gain: float

    @property
    def relative_order(self) -> int:
        """How many more poles than zeros it has."""
        return len(self.poles) - len(self.zeros)


def transfer_function(a: Floats, b: Floats, c: Floats, d: float = 0.0) -> Rational:
    """Return the transfer function of a continuous single-input single-output system.

    States are balanced and time is scaled first. The relative order is that of the first Markov
    parameter that is not rounding noise, so that it does not hang on the last digit.
    """
    scale = max(float(np.max(np.abs(np.linalg.eigvals(a)))), 1e-12)
    balanced, transform = matrix_balance(a)
    slow = balanced / scale
    into, out = np.linalg.solve(transform, b) / scale, c @ transform
    size_in, size_out = np.linalg.norm(into), np.linalg.norm(out)
    into, out = into / size_in, out / size_out
    n = len(a)
    order, leading = 0, d
    if d == 0.0:
        state, original = into, b
        while order < n:
            order, leading = order + 1, float(c @ original)
            if abs(out @ state) > NOTHING:
                break
            state, original = slow @ state, a @ original
    pencil = np.zeros((n + 1, n + 1))
    pencil[:n, :n], pencil[:n, n], pencil[n, :n] = slow, into, out
    pencil[n, n] = d / (size_in * size_out)
    mass = np.eye(n + 1)
    mass[n, n] = 0.0
    found = eigvals(pencil, mass)
    size = np.where(np.isfinite(found), np.abs(found), np.inf)
    zeros = found[np.argsort(size)][: n - order] * scale
    return Rational(zeros, np.linalg.eigvals(a).astype(np.complex128), leading)


@lru_cache(maxsize=512)
def low_pass(order: int, cutoff_hz: float) -> Rational:
    """Return the Butterworth low pass with unit gain at rest."""
    from scipy.signal import butter  # takes long to import

    z, p, k = butter(order, 2.0 * math.pi * cutoff_hz, analog=True, output="zpk")
    return Rational(np.asarray(z, complex), np.asarray(p, complex), float(np.real(k)))


def inverse_times(plant: Rational, low: Rational, what: str) -> Rational:
    """Return the low pass divided by a plant."""
    if low.relative_order < plant.relative_order:
        raise ConfigurationError(
            f"The low pass before the inverse of {what} must have at least order "
            f"{plant.relative_order}, got {low.relative_order}."
        )
    bad = [zero for zero in plant.zeros if is_not_left(zero, plant)]
    if bad:
        raise ConfigurationError(
            f"{what} cannot be inverted: it has {zeros_text(bad)} that are not in the left half "
            "plane. Choose another measured signal or structure."
        )
    return Rational(
        np.concatenate([low.zeros, plant.poles]),
        np.concatenate([low.poles, plant.zeros]),
        low.gain / plant.gain,
    )


def is_not_left(zero: complex, plant: Rational) -> bool:
    """Return whether a zero of a plant is not in the left half plane."""
    return bool(zero.real > -NOTHING * np.max(np.abs(plant.poles)))


def zeros_text(zeros: Sequence[complex]) -> str:
    """Return zeros in words."""
    return f"zeros, {', '.join(root_text(zero) for zero in zeros if zero.imag >= 0.0)},"


def tustin(system: Rational, dt: float) -> StateSpace:
    """Return its bilinear discretisation as a state space, in sections of second order."""
    from scipy.signal import bilinear_zpk, zpk2sos  # takes long to import

    z, p, k = bilinear_zpk(system.zeros, system.poles, system.gain, 1.0 / dt)
    sections = [_section(row) for row in zpk2sos(z, p, k)]
    whole = sections[0]
    for one in sections[1:]:
        whole = series(whole, one)
    return whole


@lru_cache(maxsize=512)
def held_low_pass(order: int, cutoff_hz: float, dt: float) -> StateSpace:
    """Return the discretisation of `low_pass` for an input that is held over a sample.

    It has no feed-through and unit gain at rest.
    """
    from scipy.signal import butter, cont2discrete, zpk2ss  # takes long to import

    z, p, k = butter(order, 1.0, analog=True, output="zpk")  # time in units of the cut-off
    a, b, c, _, _ = cont2discrete(zpk2ss(z, p, k), 2.0 * math.pi * cutoff_hz * dt)
    return np.asarray(a), np.asarray(b)[:, 0], np.asarray(c)[0], 0.0


def delayed(system: StateSpace, samples: int) -> StateSpace:
    """Return a system whose input arrives some samples late."""
    if samples == 0:
        return system
    a = np.eye(samples, k=-1)
    b, c = np.eye(samples)[0], np.eye(samples)[-1]
    return series((a, b, c, 0.0), system)


def series(first: StateSpace, second: StateSpace) -> StateSpace:
    """Return the second system behind the first."""
    a1, b1, c1, d1 = first
    a2, b2, c2, d2 = second
    m, n = len(b1), len(b2)
    a = np.zeros((m + n, m + n))
    a[:m, :m], a[m:, m:], a[m:, :m] = a1, a2, np.outer(b2, c1)
    return a, np.concatenate([b1, d1 * b2]), np.concatenate([d2 * c1, c2]), d1 * d2


def _section(row: Floats) -> StateSpace:
    b0, b1, b2, _, a1, a2 = row
    a = np.array([[-a1, -a2], [1.0, 0.0]])
    return a, np.array([1.0, 0.0]), np.array([b1 - a1 * b0, b2 - a2 * b0]), float(b0)
