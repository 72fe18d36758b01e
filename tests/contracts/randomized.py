"""Randomised joints on which tests are run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cjt_gym import load_joint
from cjt_gym.joint import Joint
from cjt_gym.plant import SimulatedPlant

NAME, STRUCTURE = "orange_80_6000", "output_fixed_rigid_gearbox"
EFFECTS: dict[str, Any] = {"coulomb": {}, "command_delay": {"delay": 2e-3}, "noise": {}}
NUM = 2000
Floats = NDArray[np.float64]


def joint(structure: str = STRUCTURE, effects: Any = None, **parameters: float) -> Joint:
    return load_joint(NAME, structure, effects=effects or EFFECTS, parameters=parameters)


def plant(spec: Any, num: int = 4, **arguments: Any) -> SimulatedPlant:
    return SimulatedPlant(joint(), num, randomization=spec, **arguments)


def drawn(spec: Any, num: int = NUM) -> dict[str, Floats]:
    p = plant(spec, num)
    p.reset(seed=5)
    return p.drawn()


def run(p: SimulatedPlant, steps: int) -> None:
    for _ in range(steps):
        p.advance(np.zeros(p.num), np.zeros(p.num))
