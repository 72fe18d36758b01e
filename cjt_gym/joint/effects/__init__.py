"""The effect table: everything that separates a real joint from the linear one.

One row per effect. From this table come the options of the environments, the names that can
be randomised, the candidates of a diagnosis, the documentation and the contract tests. An
effect is one row here and one term in the kernel; `fields` name the kernel's parameters.
"""

from __future__ import annotations

from cjt_gym.joint.effects.drive import DRIVE_EFFECTS
from cjt_gym.joint.effects.load import LOAD_EFFECTS
from cjt_gym.joint.effects.motor import MOTOR_EFFECTS
from cjt_gym.joint.effects.row import (
    CHANNEL_UNITS,
    PLACES,
    STAGES,
    Effect,
    EffectParameter,
    body_of,
)
from cjt_gym.joint.effects.sensing import SENSING_EFFECTS
from cjt_gym.joint.effects.transmission import TRANSMISSION_EFFECTS

EFFECTS: dict[str, Effect] = {
    row.name: row
    for row in (
        *DRIVE_EFFECTS,
        *MOTOR_EFFECTS,
        *TRANSMISSION_EFFECTS,
        *SENSING_EFFECTS,
        *LOAD_EFFECTS,
    )
}

__all__ = [
    "CHANNEL_UNITS",
    "EFFECTS",
    "PLACES",
    "STAGES",
    "Effect",
    "EffectParameter",
    "body_of",
]
