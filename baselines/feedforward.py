"""The motor's motion as predicted from the reference alone, which several laws use."""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.filters import FilteredDerivative
from cjt_gym.baselines.linear_law import Block, LinearLaw, assemble, static
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import CUTOFF_HZ, damping_gains, pid
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.baselines.robust import best_gains
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement

LOAD_HZ = 10.0
"""Low pass of the load's velocity: against its noise at rest [Hz]."""


class ReferenceVelocity:
    """The motor velocity that a reference asks for, dr/dt over the joint's stiffness, plus dq_l.

    The sign of that velocity is what laws use, so that noise of dq_l would come out as large as
    friction is wherever the joint rests: dq_l goes through a low pass of first order at 10 Hz.
    """

    def __init__(self, joint: Joint, dt: float) -> None:
        self.stiffness = SampledJoint(joint, dt).stiffness
        self.rate = FilteredDerivative(min(CUTOFF_HZ, 0.4 / dt), dt)
        self.share = -math.expm1(-2.0 * math.pi * LOAD_HZ * dt)  # of a new dq_l, in a sample
        self._load = np.zeros(0)

    def step(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        """Return the velocity [rad/s], shape (n,)."""
        seen = measurement.dq_l
        before = np.where(fresh, seen, self._load) if len(self._load) == len(fresh) else seen
        self._load = before + self.share * (seen - before)
        return np.asarray(self.rate.step(reference, fresh) / self.stiffness + self._load)


def pd_law(kp: float, kd: float, dt: float, *more: Block, lead: float = 0.0) -> LinearLaw:
    """Return feed-forward and PD, without lead with the torque's derivative, and more blocks."""
    return assemble(dt, static(reference=1.0), pid(kp, 0.0, kd, dt, lead), *more)


def dob_candidates(model: SampledJoint) -> list[dict[str, float]]:
    """Return candidates for `pd_law` with a disturbance observer: kp, kd [s], dob_hz [Hz]."""
    damping = damping_gains(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5))
    cutoffs = (0.2, 2.0, 4.0, 6.0, 9.0, 14.0, 20.0, 35.0, 60.0)
    return grid(kp=(0.0, 0.15, 0.3, 0.6, 1.0), kd=damping, dob_hz=cutoffs)


def pd_defaults(model: SampledJoint) -> dict[str, float]:
    """Return the default gains of `pd_law` for a joint; see `cjt_gym.baselines.robust`."""
    damping = damping_gains(model, (0.0, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5))
    candidates = grid(kp=(0.0, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0), kd=damping)
    return best_gains(model, lambda g: pd_law(g["kp"], g["kd"], model.dt), candidates)
