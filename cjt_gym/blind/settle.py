"""Rest position of a locked joint before its drive is switched on."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from cjt_gym.blind.control import Gains
from cjt_gym.blind.plant import World
from cjt_gym.blind.run import no_chances, run
from cjt_gym.blind.state import Q

TIME: Final = 1.0
"""Time to come to rest [s]."""
STEP: Final = 1e-4
"""Step of the integrator [s]."""


def settled(world: World) -> World:
    """Return a locked joint that starts where it rests with its drive off.

    Otherwise a torque offset or cogging would make the joint swing as the record begins, which no
    real joint does and which would reveal the effect. A free joint, or one that starts in motion,
    is unchanged: it is released as the record begins.
    """
    if not world.structure.is_locked or world.start:
        return world
    p = world.plant
    critical = 2.0 * math.sqrt(p.k_b * (p.I_m + p.I_g))
    damped = replace(world, plant=p._replace(d_m=p.d_m + critical))
    samples = round(TIME / world.sampling)
    idle = run(damped, np.zeros(samples), Gains(), no_chances(damped, samples), fine_step=STEP)
    q_m, q_g = idle.states[-1, Q : Q + 2]
    return replace(world, start={"twist": float(q_g), "wind": float(q_m - q_g)})
