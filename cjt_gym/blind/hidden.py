"""Effects that may separate a joint from its datasheet: how they are drawn and what they change.

An effect is one row of a table and one function. The function takes the joint, the scales of its
signals, and where the effect acts; it returns the changed joint and the effect's parameters.
`Draw.size` scales all magnitudes by one strength: 1 is material, 0.1 small, 0 changes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cjt_gym.blind.plant import BODY_NAMES, Structure, World
from cjt_gym.blind.scales import Scales

Parameters = dict[str, float]
Outcome = tuple[World, Parameters]
Places = tuple[str, ...]


@dataclass(frozen=True)
class Draw:
    """Random magnitudes of one effect."""

    rng: np.random.Generator
    scales: Scales  # sizes of the joint's signals
    strength: float = 1.0  # factor on every magnitude
    place: str = ""  # body or channel on which the effect acts; empty if there is no choice

    def size(self, low: float, high: float) -> float:
        """Return a log-uniform magnitude, times the strength."""
        return self.plain(low, high) * self.strength

    def plain(self, low: float, high: float) -> float:
        """Return a log-uniform number, independent of the strength."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def sign(self) -> float:
        """Return +1 or -1."""
        return float(self.rng.choice([-1.0, 1.0]))

    def ratio(self, low: float, high: float) -> float:
        """Return a factor whose logarithm has a magnitude between low and high."""
        return float(np.exp(self.sign() * self.size(low, high)))

    @property
    def body(self) -> int:
        """Index of the body on which the effect acts."""
        return BODY_NAMES.index(self.place)

    @property
    def suffix(self) -> str:
        """Suffix of that body's parameters."""
        return self.place[0]

    @property
    def torque(self) -> float:
        """Torque that moves that body, root mean square [N m]."""
        on_load = self.place == "load"
        return self.scales.joint_torque if on_load else self.scales.motor_torque


@dataclass(frozen=True)
class Effect:
    """One row of a table of effects.

    Attributes:
        name: Its name.
        stage: Stage in which it appears.
        apply: Changes a joint.
        places: Bodies or channels it may act on in a structure; ("",) if there is no choice, ()
            if the structure cannot have it.
        units: Unit of each of its parameters.
    """

    name: str
    stage: str
    apply: Callable[[World, Draw], Outcome]
    places: Callable[[Structure], Places]
    units: dict[str, str]


def on_plant(world: World, **values: float) -> World:
    """Return the joint with other values in its plant."""
    return replace(world, plant=world.plant._replace(**values))


def on_drive(world: World, **values: float) -> World:
    """Return the joint with other values in its drive."""
    return replace(world, drive=world.drive._replace(**values))


def on_sensing(world: World, **values: float) -> World:
    """Return the joint with other values in its sensors."""
    return replace(world, sensing=world.sensing._replace(**values))


def anywhere(_structure: Structure) -> Places:
    """Allow every structure, without a choice of place."""
    return ("",)


def with_spring(structure: Structure) -> Places:
    """Require a torsion bar."""
    return ("",) if structure.bar_is_soft else ()


def with_load(structure: Structure) -> Places:
    """Require a load that moves."""
    return () if structure.is_locked else ("",)


def drive_side(structure: Structure) -> Places:
    """Return the motor and, if it moves separately, the gear."""
    return ("motor", "gear") if structure.gear_is_soft else ("motor",)


def bodies(structure: Structure) -> Places:
    """Return the bodies that move separately."""
    own = structure.bar_is_soft and not structure.is_locked
    return (*drive_side(structure), "load") if own else drive_side(structure)


def periods(draw: Draw, world: World) -> float:
    """Return a frequency over q_m with at least three periods within the travel [1/rev].

    Half of these frequencies are harmonics of the rotor's revolution.
    """
    n = world.plant.n
    least = max(2.0, 6.0 * np.pi / max(draw.scales.travel, 1e-6) / n)
    order = draw.plain(least, 4.0 * least)
    return float(n * (np.ceil(order) if draw.rng.random() < 0.5 else order))


def row(
    name: str,
    stage: str,
    places: Callable[[Structure], Places] = anywhere,
    **units: str,
) -> Callable[[Callable[[World, Draw], Outcome]], Effect]:
    """Return a decorator that turns a function into a row."""

    def made(apply: Callable[[World, Draw], Outcome]) -> Effect:
        return Effect(name, stage, apply, places, units)

    return made


def table(namespace: dict[str, Any]) -> dict[str, Effect]:
    """Return the rows defined in a module, by name."""
    return {entry.name: entry for entry in namespace.values() if isinstance(entry, Effect)}
