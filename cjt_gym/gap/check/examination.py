"""What an examination of a record says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cjt_gym.gap.check.channels import Channel


@dataclass(frozen=True)
class CannotTell:
    """An effect that a record cannot tell.

    Attributes:
        name: Name of the effect.
        why: The reason, with the figure that decides.
        instead: What to record instead.
    """

    name: str
    why: str
    instead: str


@dataclass(frozen=True)
class Examination:
    """What a record can and cannot tell, before any fit.

    Attributes:
        can_tell: Effects that it would show.
        cannot_tell: Effects that it would not show, each with its reason.
        faults: What is wrong with the log, a sentence each.
        smallest: For each effect that it would show, from which size on, and its unit.
        advice: What to record instead, a sentence each.
        channels: What each channel is by itself.
        notes: What is worth knowing of the log and no fault, a sentence each.
    """

    can_tell: tuple[str, ...]
    cannot_tell: tuple[CannotTell, ...]
    faults: tuple[str, ...]
    smallest: Mapping[str, tuple[float, str]]
    advice: tuple[str, ...]
    channels: Mapping[str, Channel]
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, object]:
        """Return what `diagnosis.json` says under ``record``."""
        return {
            "can_tell": list(self.can_tell),
            "cannot_tell": [{"name": row.name, "why": row.why} for row in self.cannot_tell],
            "faults": list(self.faults),
            "notes": list(self.notes),
        }
