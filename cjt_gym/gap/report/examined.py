"""An examination as plain text."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from cjt_gym.gap.check.channels import Channel
from cjt_gym.gap.check.examination import Examination
from cjt_gym.gap.check.verdicts import sized
from cjt_gym.gap.report.summary import WIDTH
from cjt_gym.gap.report.table import Table
from cjt_gym.joint import EFFECTS

LIMITS = frozenset({"current_saturation"})
"""Effects that show where they act at less, rather than at more, than a given size."""
NOT_TRIED = "A diagnosis does not look for any of these."
HEAD = ("channel", "unit", "from", "to", "resolution", "noise", "missing")


def examination_text(found: Examination, width: int = WIDTH) -> str:
    """Return an examination as text with lines of at most `width` characters."""
    channels = Table("Channels", "", [HEAD, *map(_row, found.channels.values())])
    sizes = [
        (name, f"{'up to ' if name in LIMITS else ''}{sized(*size)}")
        for name, size in found.smallest.items()
    ]
    parts = [channels.text(width), _list("Faults of the log", found.faults, width, "none found")]
    if found.notes:
        parts.append(_list("Remarks", found.notes, width, ""))
    if sizes:
        parts.append(Table("Identifiable", "", [("effect", "from"), *sizes]).text(width))
    else:
        parts.append("Identifiable\nnothing")
    names: dict[str, list[str]] = {}
    for row in found.cannot_tell:
        names.setdefault(row.why, []).append(row.name)
    known = {*found.can_tell, *(row.name for row in found.cannot_tell)}
    names[NOT_TRIED] = [name for name in EFFECTS if name not in known]
    reasons = [f"{', '.join(effects)}: {why}" for why, effects in names.items()]
    parts.append(_list("Not identifiable", reasons, width, "nothing"))
    parts.append(_list("What to record instead", found.advice, width, "nothing else is needed"))
    return "\n\n".join(parts)


def _list(title: str, lines: Sequence[str], width: int, none: str) -> str:
    wrapped = [
        line
        for words in lines or [none]
        for line in textwrap.wrap(words, width, initial_indent="- ", subsequent_indent="  ")
    ]
    return "\n".join([title, *wrapped])


def _row(channel: Channel) -> tuple[str, ...]:
    return (
        channel.name,
        channel.unit,
        f"{channel.low:.4g}",
        f"{channel.high:.4g}",
        f"{channel.resolution:.2g}" if channel.resolution else "-",
        f"{channel.observed:.2g}" if channel.observed else "-",
        f"{100.0 * channel.missing:.2g} %",
    )
