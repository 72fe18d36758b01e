"""What was done to a log, and what was noticed in it, in words that a report can print."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

KINDS: Final = (
    "unreadable",
    "order",
    "repeated",
    "cut",
    "missing",
    "wrap",
    "glitch",
    "stale",
    "saturation",
    "unit",
    "sign",
    "lateness",
    "sampling",
)


@dataclass(frozen=True)
class Repair:
    """One thing that was repaired or noticed.

    Attributes:
        kind: One of :data:`KINDS`.
        channel: The column it concerns; None where it concerns whole rows.
        count: Number of samples or rows.
        changed: Whether the record was changed; otherwise it was only noticed.
        text: What it is, a sentence.
    """

    kind: str
    channel: str | None
    count: int
    changed: bool
    text: str

    def __post_init__(self) -> None:
        assert self.kind in KINDS, self.kind

    def __str__(self) -> str:
        return self.text


def counted(count: int, one: str) -> str:
    """Return a number with its noun.

    Example:
        >>> counted(1, "row"), counted(2, "row")
        ('1 row', '2 rows')
    """
    return f"{count} {one}" if count == 1 else f"{count} {one}s"


def share(count: int, total: int) -> str:
    """Return a share in per cent, never rounded to nothing.

    Example:
        >>> share(1, 8), share(1, 100000)
        ('12.5 %', '0.001 %')
    """
    return f"{100.0 * count / max(total, 1):.3g} %"
