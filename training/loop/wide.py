"""Randomisation by somebody who does not diagnose: wide enough for whatever a joint may hide."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.quantity import Quantity

FACTORS: Final = {"I_m": (0.6, 1.5), "k_t": (0.65, 1.35), "k_b": (0.6, 1.5)}
"""Factors on the values of the datasheet."""
SHARES: Final = {"coulomb.d_cm": (0.0, 0.06), "torque_offset.torque": (-0.05, 0.05)}
"""Torques over the peak torque of the motor [-]."""
VALUES: Final = {"torque_gain.gain": (0.75, 1.25), "command_delay.delay": (0.0, 0.012)}
"""Values as they are [-, s]."""
NEUTRAL: Final = {
    "coulomb": {"d_cm": Quantity(1e-6, "N m")},
    "torque_offset": {"torque": Quantity(0.0, "N m")},
    "torque_gain": {"gain": Quantity(1.0, "-")},
    "command_delay": {"delay": Quantity(0.0, "s")},
}
"""The effects before anything is drawn."""


def with_room(file: JointFile) -> JointFile:
    """Return a joint with the effects that `wide_randomization` draws."""
    return replace(file, effects={**file.effects, **NEUTRAL})


def wide_randomization(file: JointFile, structure: str) -> dict[str, Any]:
    """Return what is drawn in every episode, and from where.

    Args:
        file: The joint of the datasheet.
        structure: How its bodies are joined.
    """
    p = file.parameters
    peak = p.k_t * p.n * p.i_p
    has_bar = "k_b" in get_structure(structure).needed_parameters
    drawn: dict[str, Any] = {n: span for n, span in FACTORS.items() if has_bar or n != "k_b"}
    for name, (low, high) in SHARES.items():
        drawn[name] = {"low": low * peak, "high": high * peak, "operation": "set"}
    for name, (low, high) in VALUES.items():
        drawn[name] = {"low": low, "high": high, "operation": "set"}
    return drawn
