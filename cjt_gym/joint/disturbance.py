"""What moves or pushes the load on top of the given input."""

from __future__ import annotations

import math

from cjt_gym.joint.arrays import TREMOR, VOLUNTARY, Batch, Setup
from cjt_gym.joint.compiled import compiled
from cjt_gym.joint.random_stream import normal

TREMOR_DAMPING = 0.05


@compiled
def disturbed_load(batch: Batch, setup: Setup, i: int, load: float) -> float:
    """Return the load input of joint i over the next control step, with all disturbances.

    A prescribed motion gets the mean velocity of a sine, so that its angle is exact at each
    sample. A free load gets the torque of a person: noise through a first-order low pass, and
    noise through a lightly damped resonance, the tremor.

    Args:
        batch: All joints.
        setup: What they share.
        i: Which joint.
        load: Load torque [N m] or load velocity [rad/s] that is given.
    """
    p, memory = batch.p[i], batch.memory[i]
    if setup.groups[2] < 0:
        if p.motion_amplitude > 0.0:
            omega, k = 2.0 * math.pi * p.motion_frequency, batch.samples[i]
            moved = math.sin(omega * (k + 1) * setup.dt) - math.sin(omega * k * setup.dt)
            load += p.motion_amplitude * moved / setup.dt
        return load
    if p.human_std > 0.0:
        keep = math.exp(-2.0 * math.pi * p.human_bandwidth * setup.dt)
        push = p.human_std * math.sqrt(1.0 - keep * keep) * normal(batch.rng, i)
        memory[VOLUNTARY] = keep * memory[VOLUNTARY] + push
        load += memory[VOLUNTARY]
    if p.tremor_std > 0.0:
        angle = 2.0 * math.pi * p.tremor_frequency * setup.dt
        keep = math.exp(-TREMOR_DAMPING * angle)
        push = p.tremor_std * math.sqrt(1.0 - keep * keep)
        c, s = keep * math.cos(angle), keep * math.sin(angle)
        one, other = memory[TREMOR], memory[TREMOR + 1]
        memory[TREMOR] = c * one - s * other + push * normal(batch.rng, i)
        memory[TREMOR + 1] = s * one + c * other + push * normal(batch.rng, i)
        load += memory[TREMOR]
    return load
