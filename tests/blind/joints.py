"""Joints and inputs that the tests of the blind simulator share."""

from __future__ import annotations

from functools import cache

import numpy as np

from cjt_gym.blind import Case, draw_case
from cjt_gym.blind.plant import STRUCTURES, Drive, Floats, Plant, World

LOCKED = "output_fixed_rigid_gearbox"
PLANT = Plant(
    I_m=0.23,
    I_g=0.0717,
    I_l=0.5,
    k_g=16000.0,
    k_b=6000.0,
    d_mg=100.0,
    d_gl=0.5,
    d_m=0.0036,
    d_g=2.2,
    d_l=0.1,
    n=80.0,
    k_t=0.078,
)
LOSSLESS = PLANT._replace(d_mg=0.0, d_gl=0.0, d_m=0.0, d_g=0.0, d_l=0.0)


def world(structure: str, plant: Plant = PLANT, **start: float) -> World:
    """Return a joint with perfect sensors and a current loop of 1 kHz."""
    return World(STRUCTURES[structure], plant, Drive(1000.0, 30.0), start=start)


def two_tones(samples: int, size: float = 1.0) -> Floats:
    """Return a current that goes through zero slowly and quickly [A], shape (samples,)."""
    t = np.arange(samples) * 1e-3
    return size * (4.0 * np.sin(2 * np.pi * 7.0 * t) + 1.5 * np.sin(2 * np.pi * 23.0 * t))


@cache
def short(
    seed: int = 4,
    effect: str = "coulomb",
    strength: float = 1.0,
    structure: str = LOCKED,
    defects: tuple[str, ...] = (),
) -> Case:
    """Return a case of two seconds with one effect, in an open loop."""
    return draw_case(
        seed,
        effects=[effect],
        structure=structure,
        excitation="composite",
        closed_loop=False,
        strength=strength,
        duration=2.0,
        defects=defects,
    )
