"""Feed-forward along the motion that a reference asks for, and candidates for gains beside it."""

from __future__ import annotations

import math

import numpy as np

from cjt_gym.baselines.controller import Floats, Mask
from cjt_gym.baselines.linear_row import grid
from cjt_gym.baselines.pid import FilteredDerivative, damping_gains, usual_cutoff
from cjt_gym.baselines.plant_model import SampledJoint
from cjt_gym.joint import Joint
from cjt_gym.plant import Measurement

LOAD_HZ = 10.0
"""Low pass of the load's velocity: against its noise at rest [Hz]."""
SHARE = 0.8
"""Of the friction that is compensated: more than there is drives a limit cycle, less only leaves
some of it."""
SMOOTHING = 0.02
"""Velocity over which the sign is smoothed [rad/s]; a sharper sign turns the command abruptly."""


class ReferenceVelocity:
    """The motor velocity that a reference asks for, dr/dt over the joint's stiffness, plus dq_l.

    The sign of that velocity is what laws use, so that noise of dq_l would come out as large as
    friction is wherever the joint rests: dq_l goes through a low pass of first order at 10 Hz.
    """

    def __init__(self, joint: Joint, dt: float) -> None:
        self.stiffness = SampledJoint(joint, dt).stiffness
        self.rate = FilteredDerivative(usual_cutoff(dt), dt)
        self.share = -math.expm1(-2.0 * math.pi * LOAD_HZ * dt)  # of a new dq_l, in a sample
        self._load = np.zeros(0)

    def step(self, measurement: Measurement, reference: Floats, fresh: Mask) -> Floats:
        """Return the velocity [rad/s], shape (n,)."""
        seen = measurement.dq_l
        before = np.where(fresh, seen, self._load) if len(self._load) == len(fresh) else seen
        self._load = before + self.share * (seen - before)
        return np.asarray(self.rate.step(reference, fresh) / self.stiffness + self._load)


class KnownFriction:
    """The friction that a joint file names, at the velocity that the reference asks for."""

    def __init__(self, joint: Joint, dt: float, share: float, smoothing: float) -> None:
        p = joint.parameters
        self.share, self.smoothing = share, smoothing
        self.coulomb = p.get("d_cm", 0.0) + p.get("d_cg", 0.0)  # of motor and gear [N m]
        self.viscous = p.get("d_m", 0.0) + p.get("d_g", 0.0)
        self.velocity = ReferenceVelocity(joint, dt)

    def step(
        self, measurement: Measurement, reference: Floats, applied: Floats, fresh: Mask
    ) -> Floats:
        """Return the friction [N m], shape (n,); see `Addition`."""
        w = self.velocity.step(measurement, reference, fresh)
        friction = self.coulomb * np.tanh(w / self.smoothing) + self.viscous * w
        return np.asarray(self.share * friction)


def pd_candidates(model: SampledJoint, **others: float) -> list[dict[str, float]]:
    """Return candidates for kp and kd [s] beside feed-forward, with fixed other gains."""
    damping = damping_gains(model, (0.0, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5))
    fixed = {name: (value,) for name, value in others.items()}
    return grid(kp=(0.0, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0), kd=damping, **fixed)


def dob_candidates(model: SampledJoint) -> list[dict[str, float]]:
    """Return the same beside a disturbance observer, dob_hz [Hz]."""
    damping = damping_gains(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5))
    cutoffs = (0.2, 2.0, 4.0, 6.0, 9.0, 14.0, 20.0, 35.0, 60.0)
    return grid(kp=(0.0, 0.15, 0.3, 0.6, 1.0), kd=damping, dob_hz=cutoffs)
