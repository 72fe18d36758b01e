"""Signals as numbers: the compiled evaluation behind every `Signal`.

A signal is a row of numbers and a 64-bit key. Its random parts are a fixed function of the key
and of the place in the sequence, so that a signal has a value at any time, past or future,
without state: that is what makes previews cheap and batches repeatable.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.compiled import compiled, inlined, lean, reordered
from cjt_gym.joint.kernel.random_stream import hashed_uniform

Floats = NDArray[np.float64]

ZERO, STEP, CHIRP, MULTISINE, SMOOTH, TABLE = range(6)
KIND, AMPLITUDE, LOW, HIGH, PERIOD, COUNT = range(6)
NEAREST = 6755399441055744.0  # 1.5 * 2^52: adding and subtracting it rounds to a whole number
SINE = (
    *(6.283185307179585, -41.341702240398284, 81.60524927557977, -76.70585968962867),
    *(42.05868995395094, -15.09450614073429, 3.817365633469135, -0.6925067010720717),
)
"""sin(2 pi x) / x over x^2 for |x| <= 1/4, through the nodes of Chebyshev; error below 2e-16."""


@inlined
def _sine(turns: float) -> float:
    """Return the sine of an angle in turns, several times faster than that of the library."""
    x = turns - ((turns + NEAREST) - NEAREST)
    x = math.copysign(min(abs(x), 0.5 - abs(x)), x)  # a branch would be guessed wrong half the time
    z = x * x
    low = SINE[0] + z * (SINE[1] + z * (SINE[2] + z * SINE[3]))
    high = SINE[4] + z * (SINE[5] + z * (SINE[6] + z * SINE[7]))
    return x * (low + (z * z) * (z * z) * high)


@lean
def _level(key: np.uint64, index: int) -> float:
    """Return level `index` of the key's sequence, in [-1, 1)."""
    return 2.0 * hashed_uniform(key, index) - 1.0


@lean
def _step(key: np.uint64, hold: float, t: float) -> float:
    return _level(key, math.floor(t / hold))


@lean
def _smooth(key: np.uint64, spacing: float, t: float) -> float:
    """Join random levels by the quintic with no velocity and acceleration at its ends."""
    knot = math.floor(t / spacing)
    s = t / spacing - knot
    start, end = _level(key, int(knot)), _level(key, int(knot) + 1)
    return start + (end - start) * s * s * s * (10.0 + s * (6.0 * s - 15.0))


@lean
def _chirp(low: float, high: float, period: float, t: float) -> float:
    """Sweep linearly from low to high [Hz] over a period [s], then back, and so on."""
    cycle = math.floor(t / period)
    s = t - cycle * period
    if int(cycle) % 2 == 1:
        low, high = high, low
    sweep = low * s + 0.5 * (high - low) * s * s / period
    before = cycle * 0.5 * (low + high) * period
    return float(_sine(before + sweep))


@reordered
def _multisine(key: np.uint64, table: Floats, t: float) -> float:
    """Add tones of equal amplitude, with the frequencies of the table, of random phase."""
    total, count = 0.0, table.shape[0]
    for j in range(count):
        total += _sine(table[j, 0] * t + hashed_uniform(key, j))
    return float(total / count)


@lean
def _table(table: Floats, t: float) -> float:
    """Interpolate rows [t, value] linearly; the table repeats."""
    rows = table.shape[0]
    span = table[rows - 1, 0] - table[0, 0]
    at = table[0, 0] + (t - math.floor(t / span) * span if span > 0.0 else 0.0)
    low, high = 0, rows - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, 0] <= at:
            low = middle
        else:
            high = middle
    width = table[high, 0] - table[low, 0]
    if width <= 0.0:
        return float(table[low, 1])
    return float(table[low, 1] + (table[high, 1] - table[low, 1]) * (at - table[low, 0]) / width)


@lean
def evaluate(row: Floats, key: np.uint64, table: Floats, t: float) -> float:
    """Return the value of a signal at time t [s]; at negative times it is what it is at 0.

    The row is [kind, amplitude, low, high, period, count]; the table holds rows [t, value] of a
    signal from a file, [f, 0] of a multisine.
    """
    t = max(t, 0.0)
    kind = int(row[KIND])
    if kind == STEP:
        return float(row[AMPLITUDE] * _step(key, row[PERIOD], t))
    if kind == CHIRP:
        return float(row[AMPLITUDE] * _chirp(row[LOW], row[HIGH], row[PERIOD], t))
    if kind == MULTISINE:
        return float(row[AMPLITUDE] * _multisine(key, table, t))
    if kind == SMOOTH:
        return float(row[AMPLITUDE] * _smooth(key, row[PERIOD], t))
    if kind == TABLE:
        return float(row[AMPLITUDE] * _table(table, t))
    return 0.0


@compiled
def evaluate_all(row: Floats, key: np.uint64, table: Floats, times: Floats) -> Floats:
    """Return the values at times t [s], shape (n,); the other arguments are those of `evaluate`."""
    values = np.empty(times.shape[0])
    for k in range(times.shape[0]):
        values[k] = evaluate(row, key, table, times[k])
    return values
