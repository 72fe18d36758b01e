"""Excitations of unit size, as samples over time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.signal import lfilter

from cjt_gym.blind.plant import Floats

REST: Final = 0.5
"""Rest at the beginning of a record [s]."""
GENTLE_CORNER: Final = 0.2
"""Corner of the high pass that keeps a free load from running away [Hz]."""
COMPOSITE: Final = (("triangles", 0.35), ("steps", 0.15), ("multisine", 0.3), ("chirp", 0.2))
"""Parts of the composite excitation and the share of time of each."""

Maker = Callable[[int, float, float, np.random.Generator], Floats]


def excitation(
    kind: str,
    samples: int,
    dt: float,
    rng: np.random.Generator,
    gentle: bool = False,
) -> Floats:
    """Return an excitation with values in about [-1, 1], shape (samples,).

    Args:
        kind: One of EXCITATIONS.
        samples: Number of samples.
        dt: Time between them [s].
        rng: Random numbers.
        gentle: Whether to remove slow components, so that a free joint does not run away.
    """
    idle = round(REST / dt)
    top = min(60.0, 0.2 / dt)
    busy = EXCITATIONS[kind](samples - idle, dt, top, rng)
    signal = np.concatenate([np.zeros(idle), busy])
    return without_slow_part(signal, dt) if gentle else signal


def without_slow_part(signal: Floats, dt: float) -> Floats:
    """Return the signal after a first-order high pass, shape (n,)."""
    keep = np.exp(-2.0 * np.pi * GENTLE_CORNER * dt)
    return np.asarray(signal - lfilter([1.0 - keep], [1.0, -keep], signal))


def composite(samples: int, dt: float, top: float, rng: np.random.Generator) -> Floats:
    """Return triangles through zero, random steps, a multisine and a chirp, one after another."""
    parts: list[Floats] = []
    for kind, share in COMPOSITE:
        length = min(round(share * samples), samples - sum(len(part) for part in parts))
        parts.append(EXCITATIONS[kind](length, dt, top, rng))
    rest = samples - sum(len(part) for part in parts)
    return np.concatenate([*parts, np.zeros(rest)])


def _zigzag(
    samples: int, dt: float, shortest: float, longest: float, rng: np.random.Generator
) -> Floats:
    """Return straight lines between turning points of alternating sign, shape (samples,)."""
    times, values, way = [0.0], [0.0], rng.choice([-1.0, 1.0])
    while times[-1] < samples * dt:
        times.append(times[-1] + rng.uniform(shortest, longest))
        values.append(way * rng.uniform(0.4, 1.0))
        way = -way
    return np.asarray(np.interp(np.arange(samples) * dt, times, values))


def triangles(samples: int, dt: float, _top: float, rng: np.random.Generator) -> Floats:
    """Return triangular ramps through zero."""
    return _zigzag(samples, dt, 0.3, 0.9, rng)


def ramp(samples: int, dt: float, _top: float, rng: np.random.Generator) -> Floats:
    """Return slow triangular ramps."""
    return _zigzag(samples, dt, 1.5, 3.5, rng)


def steps(samples: int, dt: float, _top: float, rng: np.random.Generator) -> Floats:
    """Return random levels, each held for 0.1 to 0.5 s."""
    out, k = np.zeros(samples), 0
    while k < samples:
        held = max(round(rng.uniform(0.1, 0.5) / dt), 1)
        out[k : k + held] = rng.uniform(-1.0, 1.0)
        k += held
    return out


def multisine(samples: int, dt: float, top: float, rng: np.random.Generator) -> Floats:
    """Return a sum of sines from 0.5 Hz up, with random phases."""
    count = int(rng.integers(12, 30))
    f = np.geomspace(0.5, top, count) * rng.uniform(0.95, 1.05, count)
    phase = rng.uniform(0.0, 2.0 * np.pi, count)
    t = np.arange(samples) * dt
    total = np.sin(2.0 * np.pi * np.outer(t, f) + phase).sum(axis=1)
    peak = np.abs(total).max()
    return np.asarray(total / peak) if peak > 0.0 else total


def chirp(samples: int, dt: float, top: float, rng: np.random.Generator) -> Floats:
    """Return a sine whose frequency rises geometrically from 1 Hz."""
    length = max(samples * dt, dt)
    growth = np.log(top)
    t = np.arange(samples) * dt
    phase = 2.0 * np.pi * length / growth * np.expm1(growth * t / length)
    return np.asarray(rng.uniform(0.5, 0.7) * np.sin(phase))


def prbs(samples: int, dt: float, _top: float, rng: np.random.Generator) -> Floats:
    """Return a binary random signal with a clock of 10 to 40 ms."""
    held = max(round(rng.uniform(0.01, 0.04) / dt), 1)
    bits = rng.choice([-0.7, 0.7], samples // held + 1)
    return np.asarray(np.repeat(bits, held)[:samples])


EXCITATIONS: Final[dict[str, Maker]] = {
    "composite": composite,
    "multisine": multisine,
    "steps": steps,
    "chirp": chirp,
    "ramp": ramp,
    "prbs": prbs,
    "triangles": triangles,
}
DRAWN: Final = ("composite", "multisine", "steps", "chirp", "ramp", "prbs")
"""Excitations of whole records."""
