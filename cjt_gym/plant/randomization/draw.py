"""The compiled draws: random scores, values, and the kernel's parameters from them.

A joint draws from its own random stream, so that a member of a batch draws what it would alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.joint.kernel.compiled import compiled
from cjt_gym.joint.kernel.random_stream import normal, uniform

# Columns of a source of randomness.
WHEN, EVERY, KEEP, IS_LINEAR = range(4)
ONCE, RESET, INTERVAL, DRIFT = range(4)

# Columns of a row, one number that varies.
MIXED_FROM, MIXED_TO = 0, 1  # which of the mixtures make its score
SHAPE, LOW, HIGH, MEAN, STD = 2, 3, 4, 5, 6
FROM, TO = 7, 8  # normal: quantiles of low and high; choice: first and last entry of the table
OPERATION, NOMINAL = 9, 10
MODE, RELATIVE, FIRST, LAST = 11, 12, 13, 14  # how fields follow; which, in the list of fields
COLUMNS = 15
UNIFORM, LOG_UNIFORM, NORMAL, CHOICE = range(4)
SET, SCALE, ADD = range(3)
REPLACES, ADDS, COUNTS_FROM = range(3)
NOTHING, SOME, LINEAR = range(3)
TINIEST = 1e-300


class Program(NamedTuple):
    """What varies and how, for compiled code."""

    sources: Floats  # independent scores, shape (sources, 4)
    rows: Floats  # numbers that vary, shape (rows, COLUMNS)
    # of which scores, and with which weights, those of the rows are made, one row's after the
    # other's, shape (entries, 2)
    mixtures: Floats
    fields: NDArray[np.int64]  # kernel parameters that they change, one row's after the other's
    table: Floats  # values and cumulative probabilities of choices, shape (entries, 2)
    is_linear: bool  # whether any of them enters the discretisation


class Draws(NamedTuple):
    """What has been drawn for n joints."""

    p: Floats  # parameter records as plain numbers, shape (n, fields)
    nominal: Floats  # record without randomisation, shape (fields,)
    scores: Floats  # present score of each source, uniform, or normal for a drift; (n, sources)
    values: Floats  # present value of each row, shape (n, rows)
    fresh: NDArray[np.bool_]  # which joints have been seeded since they drew last, shape (n,)
    # which joints drew within the episode in the last control step, shape (n,)
    changed: NDArray[np.bool_]


@compiled
def normal_share(z: float) -> float:
    """Return the probability that a standard normal number is below z."""
    return 0.5 * math.erfc(-z * math.sqrt(0.5))


@compiled
def normal_quantile(u: float) -> float:
    """Return the z with `normal_share(z)` = u, to rounding.

    A rational approximation and two steps of Halley's method.

    References:
        Abramowitz, Stegun (1964), Handbook of Mathematical Functions, 26.2.23.
    """
    tail = max(min(u, 1.0 - u), TINIEST)
    t = math.sqrt(-2.0 * math.log(tail))
    top = 2.515517 + t * (0.802853 + t * 0.010328)
    z = top / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308))) - t
    for _ in range(2):
        step = (normal_share(z) - tail) * math.sqrt(2.0 * math.pi) * math.exp(0.5 * z * z)
        z -= step / (1.0 + 0.5 * z * step)
    return z if u < 0.5 else -z


@compiled
def refresh(program: Program, draws: Draws, rng: NDArray[np.uint64], i: int, step: int) -> int:
    """Draw the scores of joint i that are due `step` control steps after its episode began.

    Returns NOTHING, SOME, or LINEAR if a parameter that enters the discretisation changes.
    """
    found, scores = NOTHING, draws.scores[i]
    for k in range(program.sources.shape[0]):
        source = program.sources[k]
        when = int(source[WHEN])
        if step == 0:
            due = when != ONCE or draws.fresh[i]
        else:
            due = when >= INTERVAL and step % int(source[EVERY]) == 0
        if not due:
            continue
        if when == DRIFT:
            keep = 0.0 if step == 0 else source[KEEP]
            scores[k] = keep * scores[k] + math.sqrt(1.0 - keep * keep) * normal(rng, i)
        else:
            scores[k] = uniform(rng, i)
        found = max(found, LINEAR if source[IS_LINEAR] == 1.0 else SOME)
    if step == 0:
        draws.fresh[i] = False
    return found


@compiled
def share_of(program: Program, scores: Floats, row: Floats) -> float:
    """Return the uniform score of a row: that of a source, or of a mixture of normal scores."""
    first, last = int(row[MIXED_FROM]), int(row[MIXED_TO])
    if first == last:
        return 0.0
    k = int(program.mixtures[first, 0])
    drifts = program.sources[k, WHEN] == DRIFT
    if last == first + 1:
        u = normal_share(scores[k]) if drifts else scores[k]
        return u if program.mixtures[first, 1] > 0.0 else 1.0 - u
    z = 0.0
    for entry in range(first, last):
        score = scores[int(program.mixtures[entry, 0])]
        z += program.mixtures[entry, 1] * (score if drifts else normal_quantile(score))
    return normal_share(z)


@compiled
def quantile(program: Program, row: Floats, u: float) -> float:
    """Return the draw of a row at a uniform score, before the operation."""
    shape, low, high = int(row[SHAPE]), float(row[LOW]), float(row[HIGH])
    if shape == UNIFORM:
        return low + (high - low) * u
    if shape == LOG_UNIFORM:
        return min(max(low * math.exp(u * math.log(high / low)), low), high)
    if shape == NORMAL:
        z = normal_quantile(row[FROM] + (row[TO] - row[FROM]) * u)
        return min(max(float(row[MEAN] + row[STD] * z), low), high)
    k, last = int(row[FROM]), int(row[TO])
    while k < last and u >= program.table[k, 1]:
        k += 1
    return float(program.table[k, 0])


@compiled
def write(program: Program, draws: Draws, i: int) -> None:
    """Write values and parameters of joint i from its scores."""
    p = draws.p[i]
    for f in range(p.shape[0]):
        p[f] = draws.nominal[f]
    for k in range(program.rows.shape[0]):
        row = program.rows[k]
        value = quantile(program, row, share_of(program, draws.scores[i], row))
        nominal, mode = row[NOMINAL], int(row[MODE])
        if row[OPERATION] == SCALE:
            value *= nominal
        elif row[OPERATION] == ADD:
            value += nominal
        draws.values[i, k] = value
        for f in range(int(row[FIRST]), int(row[LAST])):
            if mode == REPLACES:
                p[program.fields[f]] = value
            elif mode == ADDS:
                p[program.fields[f]] += value - nominal
            else:
                p[program.fields[f]] = value - p[int(row[RELATIVE])]
