"""Feed-forward of reference and friction, with PD.

    u = r + kp e + kd F e_d + share (d_c tanh(w / w_0) + d_v w),   w = dr/dt / k + dq_l,
    e_d = -tau or, with lead, e

w is the velocity at which the motor has to move for the spring k (and the gearbox in series with
it) to follow the reference, so that neither noise nor delay of a measured velocity enters, and the
friction cannot be compensated into a limit cycle. d_c and d_v are the Coulomb and viscous friction
of motor and gear that the joint file names. At rest the direction is not known and nothing is
added.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.baselines.compensation import CompensatedPd, compensated_row
from cjt_gym.baselines.controller import Floats, Mask, check
from cjt_gym.baselines.entry import Gain
from cjt_gym.baselines.feedforward import ReferenceVelocity
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement

SHARE = 0.8
"""Of the friction that is compensated: more than there is drives a limit cycle, less only leaves
some of it."""
SMOOTHING = 0.02
"""Velocity over which the sign is smoothed [rad/s]; a sharper sign turns the command abruptly."""


class KnownFriction:
    """The friction that a joint file names, at the velocity that the reference asks for."""

    def __init__(self, joint: Joint, dt: float, share: float, smoothing: float) -> None:
        p = joint.parameters
        self.share, self.smoothing = share, smoothing
        self.coulomb = p.get("d_cm", 0.0) + p.get("d_cg", 0.0)  # of motor and gear [N m]
        self.viscous = p.get("d_m", 0.0) + p.get("d_g", 0.0)
        self.velocity = ReferenceVelocity(joint, dt)

    def step(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        """Return the friction [N m], shape (n,)."""
        w = self.velocity.step(measurement, reference, fresh)
        friction = self.coulomb * np.tanh(w / self.smoothing) + self.viscous * w
        return np.asarray(self.share * friction)


@final
@dataclass(eq=False)
class FrictionFeedForward(CompensatedPd):
    """Feed-forward of friction, and PD; see the module.

    `model`, `kp`, `kd` and `lead` are those of `CompensatedPd`.
    """

    share: float  # of the friction that is compensated, >= 0 [-]
    smoothing: float  # w_0, the velocity over which the sign is smoothed, > 0 [rad/s]
    torque_limit: float  # largest motor torque that is commanded [N m]

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self, "share", "", low=0.0)
        check(self, "smoothing", "rad/s", above=0.0)
        self.friction = KnownFriction(self.model.joint, self.dt, self.share, self.smoothing)

    def _compensation(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        return self.friction.step(measurement, reference, fresh)


ROW = compensated_row(
    FrictionFeedForward,
    lambda model, pd: {"share": SHARE, "smoothing": SMOOTHING},
    name="friction_feedforward",
    summary="Feed-forward of reference and known friction, and PD.",
    source="Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)",
    tunable=(
        Gain("share", "-", 0.0, 1.5),
        Gain("smoothing", "rad/s", 1e-4, 1.0, log=True),
    ),
)
