"""Result of the examination of a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cjt_gym.gap.check.channels import Channel


@dataclass(frozen=True)
class CannotTell:
    """An effect that a record cannot identify, why, and what to record instead."""

    name: str
    why: str
    instead: str


@dataclass(frozen=True, repr=False)
class Examination:
    """What a record can and cannot identify, before any fit.

    Attributes:
        can_tell: Effects that it would show.
        cannot_tell: Effects that it would not show, each with its reason.
        faults: Faults of the log, a sentence each.
        smallest: Smallest visible size and its unit, for each effect that it would show.
        advice: What to record instead, a sentence each.
        channels: Properties of each channel.
        notes: Remarks on the log that are not faults, a sentence each.
        at_rest: Whether nothing moves by more than its noise.
        hardly_moves: Whether the motor moves in too few samples for anything to be told of it.
        back: Share of the moving samples that go the rarer way.
    """

    can_tell: tuple[str, ...]
    cannot_tell: tuple[CannotTell, ...]
    faults: tuple[str, ...]
    smallest: Mapping[str, tuple[float, str]]
    advice: tuple[str, ...]
    channels: Mapping[str, Channel]
    notes: tuple[str, ...] = ()
    at_rest: bool = False
    hardly_moves: bool = False
    back: float = 0.0

    def __str__(self) -> str:
        """Return all of it as plain text, as `cjt-gym check` prints it."""
        from cjt_gym.gap.report.examined import examination_text

        return examination_text(self)

    def __repr__(self) -> str:
        """Return how many effects it would show, and how many faults the log has."""
        known = len(self.can_tell) + len(self.cannot_tell)
        return (
            f"<Examination: {len(self.can_tell)} of {known} effects identifiable, "
            f"faults of the log: {len(self.faults)}>"
        )

    def to_dict(self) -> dict[str, object]:
        """Return the contents of ``record`` in `diagnosis.json`."""
        return {
            "can_tell": list(self.can_tell),
            "cannot_tell": [{"name": row.name, "why": row.why} for row in self.cannot_tell],
            "faults": list(self.faults),
            "notes": list(self.notes),
        }
