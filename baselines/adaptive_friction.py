"""Adaptive friction compensation: the Coulomb level is learnt while the joint moves.

    d_c' = -rate d|v|/dt + (rate / J) (u - tau - d_c sign v) sign v,   u = v_pd + d_c tanh(w / w_0)

is the reduced-order observer of Friedland and Park with unit exponent, for the motor's momentum
J v = I_m dq_m + I_g dq_g: its error decays with rate / J as long as the joint moves. It learns
where |v| passes a threshold above the noise of the velocity, and holds the level elsewhere. The
direction of the compensation is that of the velocity w which the reference asks for, as in
`cjt_gym.baselines.friction_feedforward`, so that compensation closes no loop of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from cjt_gym.baselines.compose import composed_row
from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.entry import Gain, Gains
from cjt_gym.baselines.feedforward import SHARE, SMOOTHING, ReferenceVelocity, pd_candidates
from cjt_gym.baselines.linear_law import LinearLaw
from cjt_gym.baselines.pid import KD, KP, LATE
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.plant import Measurement

RATE_HZ = 1.0
"""Bandwidth of the learning [Hz], slow against the motion, so that a mean is learnt."""
THRESHOLD = 0.05
"""Velocity above which it learns [rad/s], above the noise of differentiated encoders."""
LARGEST_SHARE = 0.2
"""Largest friction that is accepted, as a share of the torque limit."""


@final
@dataclass(eq=False)
class AdaptiveFriction:
    """A Coulomb friction that is learnt; see the module."""

    model: SampledJoint
    rate_hz: float  # bandwidth of the learning, rate / (2 pi J), > 0 [Hz]
    threshold: float  # velocity above which it learns, > 0 [rad/s]
    share: float  # of the friction that is compensated, >= 0 [-]
    # largest motor torque that is commanded; a friction above a fifth of it is rejected [N m]
    torque_limit: float

    def __post_init__(self) -> None:
        self.dt = self.model.dt
        self.velocity = ReferenceVelocity(self.model.joint, self.dt)
        self.level, self._speed = np.zeros(0), np.zeros(0)
        self._sent = np.zeros((0, 0))

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return the friction [N m], shape (n,); see `Addition`."""
        self._learn(measurement, applied, fresh)
        w = self.velocity.step(measurement, reference, fresh)
        return np.asarray(self.share * self.level * np.tanh(w / SMOOTHING))

    def _learn(self, measurement: Measurement, applied: Floats, fresh: Mask) -> None:
        """Update the levels with what happened since the sample before."""
        p, late = self.model.joint.parameters, self.model.loop.delay + 1
        momentum = p.I_m * measurement.dq_m + p.get("I_g", 0.0) * measurement.dq_g
        v = momentum / self.model.inertia
        if len(self.level) != len(fresh):
            self.level, self._speed = np.zeros(len(fresh)), v.copy()
            self._sent = np.tile(measurement.tau[:, None], late)
        self._sent = np.column_stack([applied, self._sent[:, :-1]])
        self._sent = np.where(fresh[:, None], measurement.tau[:, None], self._sent)
        self.level = np.where(fresh, 0.0, self.level)
        gain, sign = 2.0 * math.pi * self.rate_hz * self.dt, np.sign(v)
        slow = np.minimum(np.abs(v), np.abs(self._speed)) < self.threshold
        still = fresh | slow | (v * self._speed <= 0.0)
        push = (self._sent[:, -1] - measurement.tau) * sign - self.level
        change = gain * (push - self.model.inertia * (np.abs(v) - np.abs(self._speed)) / self.dt)
        learnt = np.clip(self.level + change, 0.0, LARGEST_SHARE * self.torque_limit)
        self.level, self._speed = np.where(still, self.level, learnt), v


def _learnt(model: SampledJoint, gains: Gains, law: LinearLaw, limit: float) -> AdaptiveFriction:
    return AdaptiveFriction(model, gains["rate_hz"], gains["threshold"], gains["share"], limit)


ROW = composed_row(
    "adaptive_friction",
    "pd+reference",
    summary="Feed-forward of reference and of a friction level that is learnt, and PD.",
    source="Friedland, Park (1992), IEEE Transactions on Automatic Control 37(10)",
    tunable=(
        *(KP, KD, LATE),
        Gain("rate_hz", "Hz", 0.01, 20.0, log=True),
        Gain("threshold", "rad/s", 1e-3, 1.0, log=True),
        Gain("share", "-", 0.0, 1.5),
    ),
    candidates=lambda model: pd_candidates(
        model, rate_hz=RATE_HZ, threshold=THRESHOLD, share=SHARE
    ),
    addition=_learnt,
)
