"""What a held output leaves open: whether joint or drive is slow, and whose friction it is."""

from __future__ import annotations

from collections.abc import Mapping

from cjt_gym.gap.horizons.prediction.log import Log
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import Joint

ALIKE = {"damping": ("current_lag",), "command_delay": ("damping",), "current_lag": ("damping",)}
"""For each cause of a slow response, the one that looks alike."""
SWINGS = 0.5
"""Damping ratio below which a held joint visibly swings."""

UNFELT: Mapping[str, tuple[str, ...]] = {
    "presliding": ("spring_hysteresis",),
    "spring_hysteresis": ("presliding",),
    "coulomb": ("coulomb_asym",),
}
"""Effects of a held joint that only its measured torque tells apart: friction before or within the
spring, and friction that differs with the direction beside an offset that nothing else shows."""
FELT: Mapping[str, tuple[str, ...]] = {
    "torque_offset": ("torque_bias",),
    "torque_bias": ("torque_offset",),
}
"""Effects that its measured torque does not tell apart: an encoder's zero makes up for either."""


def held_alike(name: str, joint: Joint, log: Log) -> tuple[str, ...]:
    """Return which effects a held joint does not tell from a named one.

    Some only its torque would tell. A joint on a held spring that does not swing answers like a
    lag, and so does a drive of which only the command was recorded. A swing would show the joint's
    own damping.

    Args:
        name: The named effect.
        joint: The joint with the effects that were found.
        log: The record.
    """
    if not joint.structure_row.output_fixed:
        return ()
    same = (FELT if "tau" in log.measured else UNFELT).get(name, ())
    return same if log.drive == "i" or _swings(joint) else (*same, *ALIKE.get(name, ()))


def _swings(joint: Joint) -> bool:
    """Return whether the motor swings on the held spring."""
    p = joint.packed()[0]
    own = body_group(joint.structure_row, "m")
    inertia, damping = (sum(float(p[f"{kind}_{b}"][0]) for b in own) for kind in "Id")
    critical = 2.0 * (inertia * float(p["k_b"][0])) ** 0.5
    return bool(damping + float(p["d_gl"][0]) < SWINGS * critical)
