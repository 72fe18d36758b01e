"""Confidence in a named effect: from its lead in evidence to the probability that it is right.

The map was fitted to blind cases by `benchmarks/calibrate.py`, which prints its numbers and checks
them on cases that it was not fitted to; `benchmarks/README.md` has the figures.
"""

from __future__ import annotations

import math

from cjt_gym.gap.stages.heldout import Trial

LEVEL = 0.73
PER_LEAD = 0.39
"""Log odds per unit of log(1 + lead)."""
OFF, OFF_MOST = 2.11, 1.0
"""Loss of log odds per unit of deviation of the held-out worth from 1, and its cap."""
UNSEEN = 0.89
"""Loss of log odds if no held-out record excites the effect."""
TENTATIVE = 2.68
"""Loss of log odds of an effect that is only tentative."""


def confidence(lead: float, trial: Trial | None, tentative: bool) -> float:
    """Return the probability that a named effect is right.

    Args:
        lead: Evidence by which the explanation leads the best one without the effect.
        trial: Worth of the effect on held-out records, None if none excites it.
        tentative: Whether it is only tentative.
    """
    odds = LEVEL + PER_LEAD * math.log1p(max(lead, 0.0))
    odds -= UNSEEN if trial is None else OFF * min(abs(trial.worth - 1.0), OFF_MOST)
    odds -= TENTATIVE if tentative else 0.0
    return 1.0 / (1.0 + math.exp(-odds))
