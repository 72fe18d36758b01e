"""A row of the table of controllers: how to make one, its gains, and where it applies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import SupportsFloat

from cjt_gym.baselines.controller import Controller
from cjt_gym.errors import ConfigurationError, check_name
from cjt_gym.joint import STRUCTURES, Joint

EVERY = tuple(STRUCTURES)
SPRUNG = tuple(name for name, row in STRUCTURES.items() if row.has_spring)
FIXED = tuple(name for name, row in STRUCTURES.items() if row.output_fixed)
"""Structures with a torsion bar, and those whose output is fixed."""
NO_SPRING = "without a torsion bar there is no joint torque to measure"
ZERO_AT_REST = (
    "with a free load the joint torque has a zero at zero frequency (a torque that lasts turns the "
    "load ever faster), which an integral or an inverse would have to cancel"
)
"""Why a law does not hold for a structure."""

Gains = Mapping[str, float]


@dataclass(frozen=True)
class Gain:
    """A number of a law that may be tuned.

    Attributes:
        name: Its name.
        unit: Its unit, "-" where it has none.
        low: Smallest value that makes sense.
        high: Largest value that makes sense.
        log: Whether it is to be searched on a logarithmic scale; then low > 0.
        asked: Whether it is a specification, such as a stiffness to render, rather than a means. A
            search does not change it.
        off: Whether it may be 0, too, which turns off what it is the gain of.
        usual: Its value if neither a design nor a gain file gives one; None if they must.
    """

    name: str
    unit: str
    low: float
    high: float
    log: bool = False
    asked: bool = False
    usual: float | None = None
    off: bool = False

    def allows(self, value: object) -> bool:
        """Return whether a value is a number in the range."""
        if not isinstance(value, SupportsFloat):
            return False
        number = float(value)
        return self.low <= number <= self.high or (self.off and number == 0.0)


@dataclass(frozen=True)
class ControllerEntry:
    """One row of the table.

    Attributes:
        name: Its name in every interface.
        summary: The law in one line.
        source: Where it comes from.
        tunable: Its gains with their ranges.
        defaults: Designs the gains for a joint and a sample time [s].
        build: Makes the controller for a joint, a sample time [s] and a value of every gain.
        structures: The structures that it holds for.
        refusal: Why it does not hold for the others with a torsion bar: as a rule, their free load.
        renders: Whether it renders a spring and a damper of its own, gains `stiffness` and
            `damping`, so that the joint torque is not meant to equal the reference.
        kind: "classical", to tell it from learned policies.
    """

    name: str
    summary: str
    source: str
    tunable: tuple[Gain, ...]
    defaults: Callable[[Joint, float], Gains]
    build: Callable[[Joint, float, Gains], Controller]
    structures: tuple[str, ...] = EVERY
    refusal: str = ZERO_AT_REST
    renders: bool = False
    kind: str = "classical"

    @property
    def searched(self) -> tuple[Gain, ...]:
        """The gains that a search may change."""
        return tuple(gain for gain in self.tunable if not gain.asked)

    def complete(self, gains: Gains) -> dict[str, float]:
        """Return gains in the order of the row, with the usual ones where some are missing."""
        usual = {gain.name: gain.usual for gain in self.tunable if gain.usual is not None}
        known = usual | dict(gains)
        return {gain.name: known[gain.name] for gain in self.tunable if gain.name in known}

    def check_structure(self, joint: Joint) -> None:
        """Raise ConfigurationError with the reason if the law does not hold for the structure."""
        if joint.structure in self.structures:
            return
        reason = self.refusal if joint.structure in SPRUNG else NO_SPRING
        raise ConfigurationError(
            f"Controller {self.name} holds for the structures {', '.join(self.structures)}, got "
            f"{joint.structure}: {reason}. Choose one of them or another controller."
        )

    def check_gains(self, gains: Gains) -> None:
        """Check the names and ranges of gains that are given.

        Raises:
            UnknownNameError: The law has no gain of that name.
            ConfigurationError: A gain is out of its range.
        """
        check_gains(f"controller {self.name}", self.tunable, gains)


def check_gains(owner: str, tunable: Iterable[Gain], gains: Gains) -> None:
    """Check the names and ranges of gains; see `ControllerEntry.check_gains`."""
    known = {gain.name: gain for gain in tunable}
    for name, value in gains.items():
        check_name(f"gain of {owner}", name, known)
        gain = known[name]
        if not gain.allows(value):
            raise ConfigurationError(
                f"Gain {name} of {owner} must be in [{gain.low:g}, {gain.high:g}] {gain.unit}"
                f"{', or 0' if gain.off else ''}, got {value!r}."
            )
