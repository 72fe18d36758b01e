"""PID with feed-forward and an inner (open-loop) disturbance observer.

    u = r + kp e + kd F e_d - d,   d = P^-1 Q tau - Q z^-delay u,   e = r - tau,
    e_d = -tau or, with lead, e

P is the linear joint from motor torque to joint torque, so that d is what friction and ripple do
at the motor, and what P lacks; see `cjt_gym.baselines.observers.disturbance`. The observer
integrates, so that the PID needs no integral.
"""

from __future__ import annotations

from functools import lru_cache

from cjt_gym.baselines.entry import FIXED, ZERO_AT_REST
from cjt_gym.baselines.feedforward import dob_candidates, pd_law
from cjt_gym.baselines.linear_law import Block, LinearLaw
from cjt_gym.baselines.linear_row import linear_row
from cjt_gym.baselines.observers.disturbance import disturbance_observer
from cjt_gym.baselines.pid import DOB_HZ, KD, KP, LATE
from cjt_gym.baselines.plant_model import SampledJoint


def inner_dob_law(
    model: SampledJoint, kp: float, kd: float, dob_hz: float, lead: float = 0.0
) -> LinearLaw:
    """Return the law; see the module, and `cjt_gym.baselines.pid` for its gains."""
    return pd_law(kp, kd, model.dt, inner_observer(model, dob_hz), lead=lead)


@lru_cache(maxsize=64)
def inner_observer(model: SampledJoint, dob_hz: float) -> Block:
    """Return the block of -d; see the module."""
    return disturbance_observer(model, dob_hz).block(disturbance=-1.0)


ROW = linear_row(
    name="pid_inner_dob",
    summary="Feed-forward and PD, with an open-loop disturbance observer of the joint.",
    source="Lee, Tomizuka (1996), IEEE Transactions on Industrial Electronics 43(1); Hopkins et "
    "al. (2015), IEEE/ASME Transactions on Mechatronics 20(6); Roozing et al. (2016), IROS",
    tunable=(KP, KD, DOB_HZ, LATE),
    law=inner_dob_law,
    candidates=dob_candidates,
    structures=FIXED,
    refusal=ZERO_AT_REST,
)
