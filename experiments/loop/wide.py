"""Randomisation without a diagnosis, with known kinds and sizes of hidden effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import Any, Final

from cjt_gym.joint import JointFile, get_structure
from cjt_gym.joint.files.quantity import Quantity

SHARE: Final = 0.2
"""How often each of the effects is there in an episode, so that one or two of them are."""
FACTORS: Final = {
    "I_m": (0.6, 0.75, 1.25, 1.4),
    "k_t": (0.65, 0.8, 0.9, 1.1, 1.2, 1.35),
    "k_b": (0.6, 0.75, 1.25, 1.4),
}
"""Factors on the values of the datasheet; without an effect they vary by their tolerances."""
TORQUES: Final = {
    "coulomb.d_cm": (0.0, 0.01, 0.02, 0.03, 0.045, 0.06),
    "torque_offset.torque": (0.0, -0.05, -0.03, -0.015, 0.015, 0.03, 0.05),
}
"""Torques over the peak torque of the motor [-], first that of no effect."""
VALUES: Final = {
    "torque_gain.gain": (1.0, 0.75, 0.9, 1.1, 1.25),
    "command_delay.delay": (0.0, 0.002, 0.004, 0.006, 0.008, 0.01, 0.012),
    "torque_delay.delay": (0.0, 0.002, 0.004, 0.006, 0.008),
}
"""Values as they are [-, s], first that of no effect."""
LAGS: Final = (0.001, 0.002, 0.004, 0.007, 0.01)
"""Time constants of the current loop [s], besides that of the datasheet."""
NEUTRAL: Final = {
    "coulomb": {"d_cm": Quantity(1e-6, "N m")},
    "torque_offset": {"torque": Quantity(0.0, "N m")},
    "torque_gain": {"gain": Quantity(1.0, "-")},
    "command_delay": {"delay": Quantity(0.0, "s")},
    "torque_delay": {"delay": Quantity(0.0, "s")},
}
"""The effects before anything is drawn."""


def with_room(file: JointFile) -> JointFile:
    """Return a joint with the effects that `wide_randomization` draws."""
    return replace(file, effects={**file.effects, **NEUTRAL})


def wide_randomization(file: JointFile, structure: str) -> dict[str, Any]:
    """Return what is drawn in every episode, and from where.

    Values vary by the tolerances of the datasheet, and each of some effects is there now and then.

    Args:
        file: The joint of the datasheet.
        structure: How its bodies are joined.
    """
    p = file.parameters
    peak = p.k_t * p.n * p.i_p
    has_bar = "k_b" in get_structure(structure).needed_parameters
    drawn: dict[str, Any] = {"preset": "identified"}
    for name, factors in FACTORS.items():
        if has_bar or name != "k_b":
            drawn[name] = {**_seldom((1.0, *factors)), "operation": "scale"}
    for name, shares in TORQUES.items():
        drawn[name] = _seldom([share * peak for share in shares])
    for name, values in VALUES.items():
        drawn[name] = _seldom(values)
    known = file.effects["current_lag"]["bandwidth"]
    assert isinstance(known, Quantity)
    drawn["current_lag.bandwidth"] = _seldom(
        [known.number, *(1.0 / (2.0 * pi * lag) for lag in LAGS)]
    )
    return drawn


def _seldom(values: Sequence[float]) -> dict[str, Any]:
    """Return a choice of the first value, or in `SHARE` of the episodes of one of the others."""
    others = len(values) - 1
    weights = [(1.0 - SHARE) / SHARE * others, *[1.0] * others]
    return {
        "distribution": "choice",
        "operation": "set",
        "values": list(values),
        "weights": weights,
    }
