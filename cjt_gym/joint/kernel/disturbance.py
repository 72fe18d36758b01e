"""Motion and torque of the load in addition to the given input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint.kernel.arrays import TREMOR, VOLUNTARY, Floats, Setup
from cjt_gym.joint.kernel.compiled import lean
from cjt_gym.joint.kernel.random_stream import normal

TREMOR_DAMPING = 0.05
"""Damping ratio of the oscillator that noise drives: its band is a tenth of its
frequency wide."""


@lean
def is_disturbed(p: Any) -> bool:
    """Whether anything besides the given input acts on the load."""
    return bool(p.motion_amplitude > 0.0 or p.human_std > 0.0 or p.tremor_std > 0.0)


@lean
def disturbed_load(
    p: Any,
    memory: Floats,
    setup: Setup,
    rng: NDArray[np.uint64],
    i: int,
    k: int,
    load: float,
) -> float:
    """Return the load input of joint i over control step k, with all disturbances.

    A prescribed motion gets the mean velocity of a sine, so that its angle is exact at each
    sample. A free load gets the torque of a person: noise through a first-order low pass, and
    noise through a lightly damped resonance, the tremor.
    """
    if setup.groups[2] < 0:
        if p.motion_amplitude > 0.0:
            omega = 2.0 * math.pi * p.motion_frequency
            moved = math.sin(omega * (k + 1) * setup.dt) - math.sin(omega * k * setup.dt)
            load += p.motion_amplitude * moved / setup.dt
        return load
    if p.human_std > 0.0:
        keep = math.exp(-2.0 * math.pi * p.human_bandwidth * setup.dt)
        push = p.human_std * math.sqrt(1.0 - keep * keep) * normal(rng, i)
        memory[VOLUNTARY] = keep * memory[VOLUNTARY] + push
        load += memory[VOLUNTARY]
    if p.tremor_std > 0.0:
        angle = 2.0 * math.pi * p.tremor_frequency * setup.dt
        keep = math.exp(-TREMOR_DAMPING * angle)
        push = p.tremor_std * math.sqrt(1.0 - keep * keep)
        c, s = keep * math.cos(angle), keep * math.sin(angle)
        one, other = memory[TREMOR], memory[TREMOR + 1]
        memory[TREMOR] = c * one - s * other + push * normal(rng, i)
        memory[TREMOR + 1] = s * one + c * other + push * normal(rng, i)
        load += memory[TREMOR]
    return load
