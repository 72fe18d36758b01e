"""Definition of a candidate, and typical magnitudes for its starting points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.candidates.number import Number, Starts
from cjt_gym.gap.recorded.fields import Fields
from cjt_gym.gap.recorded.setting import Setting

Values = Mapping[str, float]
Apply = Callable[[Fields, Values], None]
BODIES = {"m": "motor", "g": "gear", "l": "load"}


@dataclass(frozen=True)
class Candidate:
    """One effect that may explain a gap."""

    name: str  # name in the effect table
    stage: str  # stage in which it appears according to the table
    unknowns: tuple[Number, ...]
    apply: Apply  # changes the fields of a model by its values
    touches: tuple[str, ...]  # stages that it changes
    body: str | None = None  # motor, gear or load, if there is a choice
    channel: str | None = None  # channel, if there is a choice
    starts: Starts = ()
    family: str = ""  # effects that are compared with each other when one of them leads
    releases: str | None = None  # datasheet field that it sets free, if that is all it does
    # kind of periodic torque whose frequency is searched in the residual, if any
    search: str | None = None
    listed: tuple[float, ...] = ()  # its numbers as the joint file lists them, if it does
    variant: str = ""  # which of several laws of the same effect
    outside: str = ""  # description of a cause that is not in the effect table

    @property
    def strained(self) -> bool:
        """Whether strained datasheet values could imitate it."""
        return self.releases is not None or self.name in ("torque_gain", "torque_bias")

    @property
    def key(self) -> tuple[str, str | None, str | None, str]:
        """Key that distinguishes it from the others."""
        return (self.name, self.body, self.channel, self.variant)


OVERDAMPED = 50.0
"""Upper bound on a joint's damping ratio."""


@dataclass(frozen=True)
class Scales:
    """Typical magnitudes in a record, from which starting points are derived."""

    torque: float  # of the motor [N m]
    speed: float  # of the motor [rad/s]
    deflection: float  # of the spring [rad]
    current: float  # [A]


def scales(setting: Setting) -> Scales:
    """Return the typical magnitudes in a record."""
    s = setting.series
    drive = s["i"] if "i" in s else s["i_cmd"]
    current = max(float(np.std(drive)), 1e-9)
    torque = max(current * abs(setting.nominal["k_t"] * setting.nominal["n"]), 1e-9)
    speed = max(float(np.std(s.speed("q_m"))), 1e-9)
    bar = max(setting.nominal["k_b"], 1e-9)
    load = setting.sprung_torque or torque
    # A deflection below the encoder's resolution is not a usable scale.
    deflection = max(load / bar, setting.std("q_m"), 1e-12)
    return Scales(torque, speed, deflection, current)


def most_damping(setting: Setting, body: str) -> float:
    """Return the largest damping that a body on a spring may plausibly have [N m s/rad].

    It is `OVERDAMPED` times critical damping; a body without a spring has no such limit.
    """
    if not setting.has_spring:
        return float(np.inf)
    inertia = (
        setting.nominal["I_l"] if body == "l" else sum(setting.nominal[f"I_{b}"] for b in "mg")
    )
    return 2.0 * OVERDAMPED * float(np.sqrt(setting.nominal["k_b"] * inertia))
