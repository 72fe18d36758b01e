"""Whether held-out records contradict those that were fitted, as records of another joint do."""

from __future__ import annotations

from collections.abc import Mapping

from cjt_gym.gap.horizons.prediction.case import Case
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, TRIVIAL, Key, relative
from cjt_gym.joint import Joint

EXPLAINED = 0.2
"""Ratio to the datasheet's error below which a joint explains the fitted records."""
WORSE, TWICE = 10.0, 2.0
"""Ratios of its error on held-out records to that, and to the datasheet's there, from which they
contradict."""


def contradicted(
    case: Case, joints: Mapping[str, Joint], held: Mapping[str, Mapping[Key, float]]
) -> str:
    """Return how held-out records contradict those that were fitted; "" if they do not.

    Args:
        case: The records.
        joints: The joints that were judged.
        held: Relative errors of each on held-out data.
    """
    if not case.apart:
        return ""
    old = _most(relative(case.fit, case.fit.errors(joints["datasheet"])))
    for name in ("found", "stages"):
        if name in joints:
            new = _most(relative(case.fit, case.fit.errors(joints[name])))
            left, given = _most(held[name]), _most(held["datasheet"])
            least = min(WORSE * max(new, TRIVIAL), TWICE * max(given, TRIVIAL))
            if new < EXPLAINED * old and left > max(least, WORSE * new):
                return (
                    f"What explains the fitted records (error {new:.1%}, datasheet {old:.0%}) does "
                    f"not hold for the held-out ones ({left:.0%}, datasheet "
                    f"{given:.0%}): they may be of another joint, or of this "
                    "one in another state."
                )
    return ""


def _most(errors: Mapping[Key, float]) -> float:
    """Return the largest error beyond the shortest horizon, which depends on the measured start."""
    return max((e for key, e in errors.items() if key[1] > min(HORIZONS)), default=0.0)
