"""No feedback: the wanted joint torque is commanded as motor torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

from cjt_gym.baselines.controller import Controller, Floats, Mask, check_sampling
from cjt_gym.baselines.entry import ControllerEntry, Gains
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement, limits_of


@final
@dataclass(eq=False)
class OpenLoop(Controller):
    """Feed-forward alone, u = r.

    With a locked output the joint torque then follows the reference as the bare joint does: with
    its friction, and with its resonance.

    Attributes:
        dt: Sample time [s].
        torque_limit: Largest motor torque that is commanded [N m].

    Raises:
        ConfigurationError: A number is out of range.
    """

    dt: float
    torque_limit: float = math.inf

    def __post_init__(self) -> None:
        check_sampling(self)

    def _command(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        return reference.copy()


def _build(joint: Joint, dt: float, gains: Gains) -> Controller:
    return OpenLoop(dt, limits_of(joint).tau)


ROW = ControllerEntry(
    name="open_loop",
    summary="Feed-forward of the reference alone, u = r.",
    source="definition",
    tunable=(),
    defaults=lambda joint, dt: {},
    build=_build,
)
