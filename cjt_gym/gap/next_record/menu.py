"""The inputs from which the next experiment is chosen, as currents of unit size over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import chirp, lfilter

from cjt_gym.joint.kernel.arrays import Floats

REST: Final = 0.5
"""Rest at the beginning of every input [s]."""
FLOATING_CORNER: Final = 0.3
"""Corner of the high pass that keeps a free load from running away [Hz]."""
LOW, HIGH = 0.5, 60.0
"""Frequencies of multisine and chirp [Hz]; at most a fifth of the sampling rate."""


@dataclass(frozen=True)
class Input:
    """One row of the menu."""

    name: str
    text: str  # description that fits into a sentence
    # returns its values within [-1, 1] at given times [s], shape (N,); it ends at the last of them
    shape: Callable[[Floats], Floats]
    size: float = 1.0  # share of the largest current, or of the friction level if `stuck`
    # whether its size is relative to the dry friction level, about which it swings
    stuck: bool = False

    def current(self, samples: int, dt: float, floating: bool) -> Floats:
        """Return the input at its unit size, shape (samples,), after a rest.

        Args:
            samples: Number of samples.
            dt: Time between them [s].
            floating: Whether the load is free, so that slow components are removed.
        """
        idle = round(REST / dt)
        out = np.zeros(samples)
        out[idle:] = self.shape(dt * np.arange(samples - idle, dtype=np.float64))
        return _without_slow_part(out, dt) if floating else out


def _without_slow_part(x: Floats, dt: float) -> Floats:
    keep = float(np.exp(-2.0 * np.pi * FLOATING_CORNER * dt))
    return np.asarray(x - lfilter([1.0 - keep], [1.0, -keep], x))


def _zigzag(t: Floats, period: float, sizes: tuple[float, ...]) -> Floats:
    """Return straight lines alternating between +size and -size, one period per size, repeated."""
    corners, values = [0.0], [0.0]
    k = 0
    while corners[-1] < t[-1] + period:
        size = sizes[k % len(sizes)]
        corners += [corners[-1] + 0.25 * period, corners[-1] + 0.75 * period]
        corners.append(corners[-1] + 0.25 * period)
        values += [size, -size, 0.0]
        k += 1
    return np.asarray(np.interp(t, corners, values))


def _ramps(t: Floats) -> Floats:
    return _zigzag(t, 0.5 * t[-1], (1.0, 0.6))


def _reversals(t: Floats) -> Floats:
    return _zigzag(t, 0.8, (1.0, 0.5, 0.25))


def _held(t: Floats, levels: tuple[float, ...], time: float) -> Floats:
    held: Floats = np.array(levels)[np.floor(t / time).astype(int) % len(levels)]
    return held


def _steps(t: Floats) -> Floats:
    return _held(t, (0.3, -0.1, 0.9, -0.6, 0.05, 1.0, -0.9, 0.5, -0.3, 0.15, -1.0, 0.0), 0.2)


def _holds(t: Floats) -> Floats:
    """Return constant levels, with ramps of a fifth of their time in between."""
    levels = (0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0)
    time = t[-1] / len(levels)
    corners, values = [0.0], [0.0]
    for k, level in enumerate(levels):
        corners += [(k + 0.2) * time, (k + 1.0) * time]
        values += [level, level]
    return np.asarray(np.interp(t, corners, values))


def _top(t: Floats) -> float:
    return float(min(HIGH, 0.2 / (t[1] - t[0])))


def _multisine(t: Floats) -> Floats:
    f = np.geomspace(LOW, _top(t), 20)
    phase = np.pi * np.arange(20) ** 2 / 20.0  # Schroeder's phases: a low crest factor
    total = np.sin(2.0 * np.pi * np.outer(t, f) + phase).sum(axis=1)
    return np.asarray(total / np.abs(total).max())


def _chirp(t: Floats) -> Floats:
    return np.asarray(chirp(t, LOW, t[-1], _top(t), "logarithmic", phi=-90.0))


def _swings(t: Floats) -> Floats:
    """Return oscillations whose amplitude grows from a tenth to one."""
    return np.asarray((0.1 + 0.9 * t / t[-1]) * np.sin(2.0 * np.pi * 2.0 * t))


def _composite(t: Floats) -> Floats:
    parts = ((_reversals, 0.35), (_steps, 0.15), (_multisine, 0.3), (_chirp, 0.2))
    ends = np.round(np.cumsum([share for _, share in parts]) * len(t)).astype(int)
    pieces = np.split(t, ends[:-1])
    return np.concatenate(
        [shape(piece - piece[0]) for (shape, _), piece in zip(parts, pieces, strict=True)]
    )


MENU: Final[Mapping[str, Input]] = {
    row.name: row
    for row in (
        Input("composite", "reversals, steps, a multisine and a chirp, in turn", _composite),
        Input(
            "small_composite",
            "reversals, steps, a multisine and a chirp, all of them small",
            _composite,
            size=0.2,
        ),
        Input("ramps", "slow ramps through zero in both directions", _ramps),
        Input("swings", "growing oscillations in the stuck region", _swings, 1.5, stuck=True),
        Input(
            "reversals", "many reversals, some just past the stuck region", _reversals, 3.0, True
        ),
        Input("steps", "steps of different sizes", _steps),
        Input("holds", "levels held in turn", _holds),
        Input("chirp", "a chirp", _chirp, size=0.5),
    )
}
