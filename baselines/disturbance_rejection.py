"""Active disturbance rejection: an extended-state observer and PD on its states.

    u = r + kp (r - tau^) - kd dtau^ - d^,   dtau^ = k_b (dq_g^ - dq_l)

tau^, dtau^ and the disturbance d^ (friction, ripple, load motion and whatever the model lacks, in
the sense of a motor torque) come from one observer with one bandwidth, so that derivative and
integral action share one filter.
"""

from __future__ import annotations

import math

from cjt_gym.baselines.entry import FIXED, Gain
from cjt_gym.baselines.linear_law import LinearLaw, assemble, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.observers.extended_state import designed
from cjt_gym.baselines.pid import KD, KP, damping_gains
from cjt_gym.baselines.plant_model import SampledJoint

OBSERVERS = (0.02, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Bandwidths of observers that are tried, relative to the torsional mode."""


def disturbance_rejection_law(
    model: SampledJoint, kp: float, kd: float, observer_hz: float
) -> LinearLaw:
    """Return the law; see the module, and the row for its gains."""
    observer = designed(model, observer_hz)
    rate = next(name for name in ("dq_g", "dq_m") if name in observer.names)
    weights = {"tau": -kp, rate: -kd * model.joint.parameters.k_b, "disturbance": -1.0}
    return assemble(model.dt, static(reference=1.0 + kp), observer.block(**weights))


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    own = abs(model.torsion) / (2.0 * math.pi)
    observer = [min(ratio * own, 0.2 / model.dt) for ratio in OBSERVERS]
    damping = damping_gains(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5))
    return grid(kp=(0.0, 0.1, 0.3, 0.6, 1.0, 2.0), kd=damping, observer_hz=observer)


ROW = linear_row(
    name="disturbance_rejection",
    summary="Active disturbance rejection: PD and disturbance from an extended-state observer.",
    source="Han (2009), IEEE Transactions on Industrial Electronics 56(3); Gao (2003), American "
    "Control Conference",
    tunable=(
        KP,
        KD,
        Gain("observer_hz", "Hz", 0.1, 250.0, log=True),
    ),
    law=disturbance_rejection_law,
    candidates=_candidates,
    structures=FIXED,
)
