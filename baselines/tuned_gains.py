"""Gains of PD with feed-forward that a search on the simulator found.

`python -m cjt_gym.training.tune_pd` made this table and says how.
"""

from __future__ import annotations

from dataclasses import dataclass

TUNED_DT = 1e-3
"""Sample time that the gains are for [s]."""


@dataclass(frozen=True)
class Gains:
    """Gains of PD with feed-forward.

    Attributes:
        kp: Proportional gain [-].
        kd: Derivative gain [s].
        derivative: Of what: "error" or "output".
    """

    kp: float
    kd: float
    derivative: str


TUNED: dict[tuple[str, str], Gains] = {
    ("avocado_100_21000", "output_fixed_rigid_gearbox"): Gains(0, 0.0005311, "error"),
    ("avocado_100_21000", "output_fixed"): Gains(0.2, 0.0005311, "error"),
    ("avocado_100_21000", "full_dynamics"): Gains(0.2, 0, "error"),
    ("example", "output_fixed_rigid_gearbox"): Gains(0.8, 0.003299, "error"),
    ("example", "output_fixed"): Gains(0.8, 0.003299, "error"),
    ("example", "rigid_gearbox"): Gains(0.8, 0.002474, "error"),
    ("example", "full_dynamics"): Gains(0.6, 0.002474, "error"),
    ("generic", "output_fixed"): Gains(2, 0.005403, "error"),
    ("lemon_50_6000", "output_fixed_rigid_gearbox"): Gains(0.1, 0.000708, "error"),
    ("lemon_50_6000", "output_fixed"): Gains(0.1, 0.001416, "error"),
    ("lemon_50_6000", "rigid_gearbox"): Gains(0, 0.000708, "output"),
    ("lemon_50_6000", "full_dynamics"): Gains(0.1, 0.000708, "output"),
    ("lime_50_21000", "output_fixed"): Gains(0.1, 0, "error"),
    ("lime_50_21000", "full_dynamics"): Gains(0.1, 0, "error"),
    ("orange_100_6000", "output_fixed_rigid_gearbox"): Gains(1, 0.007091, "error"),
    ("orange_100_6000", "output_fixed"): Gains(1, 0.007091, "error"),
    ("orange_100_6000", "rigid_gearbox"): Gains(1, 0.007091, "error"),
    ("orange_100_6000", "full_dynamics"): Gains(1, 0.007091, "error"),
    ("orange_80_6000", "output_fixed_rigid_gearbox"): Gains(1, 0.005673, "error"),
    ("orange_80_6000", "output_fixed"): Gains(1, 0.005673, "error"),
    ("orange_80_6000", "rigid_gearbox"): Gains(0.6, 0.005673, "error"),
    ("orange_80_6000", "full_dynamics"): Gains(0.8, 0.005673, "error"),
    ("pomegranate_160_9000", "output_fixed_rigid_gearbox"): Gains(1.5, 0.006266, "error"),
    ("pomegranate_160_9000", "output_fixed"): Gains(1, 0.006266, "error"),
    ("pomegranate_160_9000", "rigid_gearbox"): Gains(1.25, 0.006266, "error"),
    ("pomegranate_160_9000", "full_dynamics"): Gains(1, 0.006266, "error"),
}
"""By joint and structure; what is not here is designed from the linear model."""
