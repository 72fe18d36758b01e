"""What one candidate is, and the sizes from which its starting points are taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cjt_gym.gap.fields import Fields
from cjt_gym.gap.setting import Setting
from cjt_gym.gap.unknowns import Unknown

Values = Mapping[str, float]
Apply = Callable[[Fields, Values], None]
BODIES = {"m": "motor", "g": "gear", "l": "load"}


@dataclass(frozen=True)
class Hypothesis:
    """One effect that may explain a gap.

    Attributes:
        name: Name in the effect table.
        stage: Where the table says that it shows itself.
        unknowns: Its numbers.
        apply: Changes the fields of a model by its values.
        touches: Stages that it changes.
        body: motor, gear or load, where that is a choice.
        channel: Channel, where that is a choice.
        starts: Values of the unknowns at which a fit starts, each of their length.
        family: Effects that are compared among each other when one of them leads.
        releases: Field of the datasheet that it sets free, where it does only that.
        search: Kind of periodic torque whose frequency is searched in the residual, if any.
        variant: Which of several laws of the same effect.
        outside: In words what it is, for a cause that is not in the effect table.
    """

    name: str
    stage: str
    unknowns: tuple[Unknown, ...]
    apply: Apply
    touches: tuple[str, ...]
    body: str | None = None
    channel: str | None = None
    starts: tuple[tuple[float, ...], ...] = ()
    family: str = ""
    releases: str | None = None
    search: str | None = None
    variant: str = ""
    outside: str = ""

    @property
    def strained(self) -> bool:
        """Whether a model without it could take its place by straining the datasheet."""
        return self.releases is not None or self.name in ("torque_gain", "torque_bias")

    @property
    def key(self) -> tuple[str, str | None, str | None, str]:
        """What tells it from the others."""
        return (self.name, self.body, self.channel, self.variant)


OVERDAMPED = 50.0
"""Damping ratio that no joint exceeds."""


@dataclass(frozen=True)
class Scales:
    """Typical sizes in a record, from which starting points are taken.

    Attributes:
        torque: Of the motor [N m].
        speed: Of the motor [rad/s].
        deflection: Of the spring [rad].
        current: [A].
    """

    torque: float
    speed: float
    deflection: float
    current: float
    duration: float = field(default=10.0)


def scales(setting: Setting) -> Scales:
    """Return the typical sizes of a record."""
    s = setting.series
    drive = s["i"] if "i" in s else s["i_cmd"]
    current = max(float(np.std(drive)), 1e-9)
    torque = max(current * abs(setting.nominal["k_t"] * setting.nominal["n"]), 1e-9)
    speed = max(float(np.std(s.speed("q_m"))), 1e-9)
    bar = max(setting.nominal["k_b"], 1e-9)
    load = float(np.std(s["tau"])) if "tau" in s else torque
    # A deflection below what the encoder resolves is no scale to work with.
    deflection = max(load / bar, setting.std("q_m"), 1e-12)
    return Scales(torque, speed, deflection, current, len(s) * s.dt)


def most_damping(setting: Setting, body: str) -> float:
    """Return the largest damping that a body on a spring may plausibly have [N m s/rad].

    It is that of `OVERDAMPED` times the critical one; a body without a spring has no such limit.

    Args:
        setting: The record and its joint.
        body: Its letter.
    """
    if not setting.has_spring:
        return float(np.inf)
    inertia = (
        setting.nominal["I_l"] if body == "l" else sum(setting.nominal[f"I_{b}"] for b in "mg")
    )
    return 2.0 * OVERDAMPED * float(np.sqrt(setting.nominal["k_b"] * inertia))
