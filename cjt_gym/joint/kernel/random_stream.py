"""A stream of random numbers per joint, advanced inside the kernel.

Each joint owns one 64-bit state, so that a member of a batch draws exactly what it would
draw alone. The generator is SplitMix64 (Steele, Lea, Flood 2014, Fast Splittable
Pseudorandom Number Generators, OOPSLA).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.compiled import lean

_STEP = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_UNIT = 2.0**-53


def seed_state(seed: int) -> np.uint64:
    """Return the initial state of a stream for an integer seed >= 0."""
    return np.uint64(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])


@lean
def mix(x: np.uint64) -> np.uint64:
    """Return a well mixed 64-bit hash of x."""
    x = (x ^ (x >> np.uint64(30))) * _MIX_1
    x = (x ^ (x >> np.uint64(27))) * _MIX_2
    return x ^ (x >> np.uint64(31))


@lean
def uniform(states: NDArray[np.uint64], i: int) -> float:
    """Draw from [0, 1) with the stream of joint i."""
    states[i] += _STEP
    return float(mix(states[i]) >> np.uint64(11)) * _UNIT


@lean
def normal(states: NDArray[np.uint64], i: int) -> float:
    """Draw from the standard normal distribution (Box and Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(states, i)))
    return radius * math.cos(2.0 * math.pi * uniform(states, i))


@lean
def hashed_uniform(key: np.uint64, index: int) -> float:
    """Return number `index` of the fixed sequence that belongs to `key`, in [0, 1)."""
    return float(mix(key + _STEP * np.uint64(index + 1)) >> np.uint64(11)) * _UNIT
