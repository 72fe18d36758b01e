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


TUNED: dict[tuple[str, str], Gains] = {}
