"""What a step is told and what it reports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cjt_gym.envs.observe import TERMS
from cjt_gym.joint.arrays import Floats

REPORT = (
    *("tau", "tau_measured", "tau_reference", "tau_command", "base_action", "residual"),
    *(f"reward/{name}" for name in TERMS),
)
"""What a step reports of an episode: keys of its info."""


class Control(NamedTuple):
    """What a step is told and what it reports."""

    action: Floats  # in [-1, 1], shape (n,); values outside are clipped
    base: Floats  # motor torque of the base controller, shape (n,) [N m]
    residual: Floats  # motor torque of the action, shape (n,) [N m]
    wanted: Floats  # both, within the limits, shape (n,) [N m]
    commands: Floats  # the same as currents [A], shape (n, 2)
    report: Floats  # columns of `REPORT`, shape (1, 11) for a single episode, else (0, 11)
    factors: Floats  # [action scale, torque limit, torque per ampere]


def make_control(num: int, action_scale: float, limit: float, torque_per_ampere: float) -> Control:
    """Allocate for `num` episodes."""
    return Control(
        action=np.zeros(num),
        base=np.zeros(num),
        residual=np.zeros(num),
        wanted=np.zeros(num),
        commands=np.zeros((num, 2)),
        report=np.zeros((1 if num == 1 else 0, len(REPORT))),
        factors=np.array([action_scale, limit, torque_per_ampere]),
    )
