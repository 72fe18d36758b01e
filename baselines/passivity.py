"""Passivity-based torque control: the motor's inertia is scaled down, the spring damped.

    u = r + (B / B_d - 1) (r - tau) - (B / B_d) D_s (dq_m - dq_l)

With measured torque and the motor's inertia B the closed loop is a smaller motor B_d in front of
the same spring, with the damper D_s beside it, B_d ddq_m + D_s (dq_m - dq_l) + tau = r, which is
passive. Delays take that from it where B / B_d or D_s is large; the default gains heed them.
"""

from __future__ import annotations

from cjt_gym.baselines.compose import composed_row

ROW = composed_row(
    "passivity",
    "passivity",
    summary="Passivity-based: inertia scaled down by torque feedback, damping of the spring.",
    source="Albu-Schaeffer, Ott, Hirzinger (2007), International Journal of Robotics Research "
    "26(1)",
)
