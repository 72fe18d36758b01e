"""A joint whose effects have free numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import EFFECTS, Joint, JointFile
from cjt_gym.joint.configure import EffectValues
from cjt_gym.joint.kernel.arrays import Floats

SKEW = frozenset({"coulomb_asym", "viscous_asym", "torque_offset"})
"""Effects that depend on the direction; several of them together compensate each other."""
MEASURES = ("noise", "quantization", "drift", "dropout", "command_noise")
"""Effects omitted from predictions: they only scatter or round the measurement."""
DRIVE = (
    "command_delay",
    "current_lag",
    "current_saturation",
    "current_rate_limit",
    "command_quantization",
)
"""Effects between a command and the current."""
SHARED = "dq_0"
Free = partial(Number, prior=False)
"""A number that nothing but the record limits."""


class Draft:
    """Parameters and effects of a joint while they are being changed."""

    def __init__(self, file: JointFile, effects: Mapping[str, EffectValues]) -> None:
        """Start from a joint's file and effects."""
        self.file = file
        self.parameters: dict[str, float] = {}
        self.effects: dict[str, EffectValues] = {name: dict(v) for name, v in effects.items()}

    def row(self, name: str) -> EffectValues:
        """Return the values of an effect, added at neutral values if absent."""
        if name not in self.effects:
            p = self.file.parameters
            self.effects[name] = {
                parameter.symbol: p.get(parameter.relative_to, 0.0)
                if parameter.relative_to is not None
                else (() if parameter.series else parameter.default or parameter.neutral or 0.0)
                for parameter in EFFECTS[name].parameters
            }
            if SHARED in self.effects[name]:
                self.effects[name][SHARED] = self.smoothing
        return self.effects[name]

    @property
    def smoothing(self) -> float:
        """Velocity over which the sign of dry friction is smoothed [rad/s]; 0 unless stated."""
        stated = [v[SHARED] for n, v in self.effects.items() if SHARED in v]
        return float(stated[0]) if stated else 0.0  # type: ignore[arg-type]

    def smooth(self, width: float) -> None:
        """Set the smoothing velocity of all dry friction [rad/s]."""
        for values in self.effects.values():
            if SHARED in values:
                values[SHARED] = width


Put = Callable[[Draft, Sequence[float]], None]


@dataclass(frozen=True)
class Term:
    """A row of the effect table with free numbers.

    Attributes:
        name: Name in the effect table.
        numbers: Its free numbers.
        put: Writes their values into a draft.
        body: "motor", "gear" or "load", if applicable.
        channel: Channel, if applicable.
        replaces: Names of terms that it replaces.
        starts: Values of the numbers from which a search starts.
        needs: Names of terms of which it requires at least one.
        nominal: Values of the numbers at which it has no effect.
        family: Name of a group of similar terms.
        factor: Factor on the price, larger for less likely terms.
        tight: The same term within its datasheet tolerance, if this one is released from it.
        told: Whether it may be named; otherwise it is only fitted.
        loose: Its number as the datasheet limits it, where a last fit holds it nearer.
    """

    name: str
    numbers: tuple[Number, ...]
    put: Put
    body: str | None = None
    channel: str | None = None
    replaces: tuple[str, ...] = ()
    starts: tuple[tuple[float, ...], ...] = ()
    needs: tuple[str, ...] = ()
    nominal: tuple[float, ...] = ()
    family: str = ""
    factor: float = 1.0
    tight: Term | None = None
    told: bool = True
    loose: Number | None = None

    @property
    def key(self) -> tuple[str, str | None, str | None]:
        """Identifier of the term: name, body and channel."""
        return (self.name, self.body, self.channel)

    @property
    def restated(self) -> bool:
        """Whether it corrects what the joint file states: a tolerance, or a listed weight."""
        return self.tight is not None or (self.name == "gravity" and any(self.nominal))

    @property
    def stage(self) -> str:
        """Stage of the effect table."""
        return EFFECTS[self.name].stage


@dataclass(frozen=True, eq=False)
class Model:
    """A joint with terms.

    Attributes:
        joint: The nominal joint, with the effects that its file lists, without noise.
        terms: Its terms.
    """

    joint: Joint
    terms: tuple[Term, ...] = ()

    @property
    def numbers(self) -> tuple[Number, ...]:
        """All free numbers, in the order of the coordinates."""
        return tuple(n for term in self.terms for n in term.numbers)

    def values(self, z: Floats) -> list[tuple[float, ...]]:
        """Return the values of each term's numbers."""
        found, at = [], 0
        for term in self.terms:
            count = len(term.numbers)
            pairs = zip(term.numbers, z[at : at + count], strict=True)
            found.append(tuple(number.value(float(x)) for number, x in pairs))
            at += count
        return found

    def span(self, index: int) -> slice:
        """Return the slice of a term's coordinates."""
        at = sum(len(term.numbers) for term in self.terms[:index])
        return slice(at, at + len(self.terms[index].numbers))

    def draft(self, z: Floats) -> Draft:
        """Return the joint's parameters and effects at given coordinates."""
        draft = Draft(self.joint.file, self.joint.effects)
        for term, values in zip(self.terms, self.values(z), strict=True):
            term.put(draft, values)
        return draft

    def at(self, z: Floats) -> Joint:
        """Return the joint at given coordinates."""
        return drafted(self.joint, self.draft(z))

    def without(self, index: int, z: Floats) -> tuple[Model, Floats]:
        """Return the model without one of its terms, or with its datasheet version instead."""
        tight, span = self.terms[index].tight, self.span(index)
        kept = () if tight is None else (tight,)
        values = np.zeros(sum(len(term.numbers) for term in kept))
        terms = (*self.terms[:index], *kept, *self.terms[index + 1 :])
        return replace(self, terms=terms), np.concatenate([z[: span.start], values, z[span.stop :]])


def drafted(joint: Joint, draft: Draft) -> Joint:
    """Return a joint with the parameters and effects of a draft."""
    file = joint.file
    if draft.parameters:
        file = replace(file, parameters=file.parameters.replace(**draft.parameters))
    return replace(joint, file=file, effects=draft.effects)


def quiet(joint: Joint, *, driven: bool = True) -> Joint:
    """Return a joint without measurement noise and rounding.

    Args:
        joint: The joint.
        driven: Whether its drive takes a command; a measured current has already passed the drive.
    """
    out = MEASURES if driven else (*MEASURES, *DRIVE)
    return replace(joint, effects={n: v for n, v in joint.effects.items() if n not in out})


@dataclass(frozen=True)
class Scales:
    """Typical magnitudes in a record; searches start from fractions of them.

    Attributes:
        torque: Standard deviation of the torque of motor and load [N m].
        speed: rms motor speed [rad/s].
        peak: Rarely exceeded torque [N m].
        travel: Range of the motor's angle [rad].
        driven: Share of the torque due to the motor.
        fast: Rarely exceeded motor speed [rad/s].
        coasts: Whether nothing drives the joint, so that torques show relative to its inertia only.
    """

    torque: float
    speed: float
    peak: float
    travel: float
    driven: float = 1.0
    fast: float = 1.0
    coasts: bool = False


def motor_inertia(joint: Joint) -> float:
    """Return the inertia of all bodies that move with the motor [kg m^2]."""
    own = body_group(joint.structure_row, "m")
    return float(sum(joint.parameters.get(f"I_{body}", 0.0) for body in own))
