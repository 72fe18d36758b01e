"""Passivity-based torque control: the motor's inertia is scaled down, the spring damped.

    u = r + (B / B_d - 1) (r - tau) - (B / B_d) D_s (dq_m - dq_l)

With measured torque and the motor's inertia B the closed loop is a smaller motor B_d in front of
the same spring, with the damper D_s beside it, B_d ddq_m + D_s (dq_m - dq_l) + tau = r, which is
passive. Delays take that from it where B / B_d or D_s is large; the default gains heed them.
"""

from __future__ import annotations

from cjt_gym.baselines.entry import SPRUNG, Gain
from cjt_gym.baselines.linear_law import Block, LinearLaw, assemble, static
from cjt_gym.baselines.linear_row import grid, linear_row
from cjt_gym.baselines.pid import damper
from cjt_gym.baselines.plant_model import SampledJoint


def passivity_block(shaping: float, damping: float) -> Block:
    """Return the law as a block, for B / B_d [-] and D_s [N m s/rad]; see the module."""
    share = shaping * damping
    return static(reference=shaping, tau=1.0 - shaping, dq_m=-share, dq_l=share)


def passivity_law(model: SampledJoint, shaping: float, damping: float) -> LinearLaw:
    """Return the law; see `passivity_block`."""
    return assemble(model.dt, passivity_block(shaping, damping))


def _candidates(model: SampledJoint) -> list[dict[str, float]]:
    shaping = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0)
    return grid(shaping=shaping, damping=damper(model, (0.0, 0.03, 0.1, 0.2, 0.3, 0.5)))


ROW = linear_row(
    name="passivity",
    summary="Passivity-based: inertia scaled down by torque feedback, damping of the spring.",
    source="Albu-Schaeffer, Ott, Hirzinger (2007), International Journal of Robotics Research "
    "26(1)",
    tunable=(Gain("shaping", "-", 1.0, 10.0), Gain("damping", "N m s/rad", 0.0, 1000.0)),
    law=passivity_law,
    candidates=_candidates,
    structures=SPRUNG,
)
