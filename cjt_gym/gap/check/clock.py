"""Sampling times of a log: their intervals and irregularities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.digits import plain
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record
from cjt_gym.records.repair_notes import counted

GAP = 5.0
"""Pause between samples above which it is a gap, in usual intervals."""
MIXED = 1.5
"""Ratio of two intervals above which they are of different kinds."""
KIND = 0.04
"""Relative spread within a kind."""
SHARE = 0.05
"""Least share of intervals that are of the rarer kind, or that jitter."""
BOTH = 0.5
"""Least share of intervals that are of either kind."""
MISSING, WHOLE = 4.5, 0.08
"""Ratio up to which a whole multiple means missing rows, and its tolerance."""
JITTER = 0.2
"""Relative deviation from the usual interval above which an interval jitters."""


def clock(records: Sequence[Record]) -> list[str]:
    """Return sentences on the sampling times of records, but for gaps.

    Of records whose intervals jitter, such as the pieces of one log, that with the widest counts.
    """
    said, jitters = [], []
    for steps in _steps(records):
        if (kinds := _kinds(steps)) is not None:
            short, slow, share = kinds
            said.append(
                f"The sampling is mixed: {1e3 * short:.3g} and {1e3 * slow:.3g} ms, the longer "
                f"ones {100.0 * share:.2g} % of the intervals."
            )
        elif np.mean(np.abs(steps / np.median(steps) - 1.0) > JITTER) > SHARE:
            jitters.append(1e3 * np.quantile(steps, [0.05, 0.95]))
    if jitters:
        low, high = max(jitters, key=lambda ends: float(ends[1]))
        said.append(f"The sampling jitters: intervals of {low:.3g} to {high:.3g} ms.")
    return list(dict.fromkeys(said))


def gaps(records: Sequence[Record]) -> list[str]:
    """Return sentences on the gaps of records."""
    found: dict[str, None] = {}
    for steps in _steps(records):
        long = steps[steps > gap_length(steps)]
        if long.size:
            longest, usual = plain(1e3 * long.max()), plain(1e3 * np.median(steps))
            said = (
                f"The log has {counted(int(long.size), 'gap')} of up to {longest} ms, where its "
                f"samples are {usual} ms apart."
            )
            found[said] = None
    return list(found)


def _steps(records: Sequence[Record]) -> list[Floats]:
    """Return the times between the samples of records that are long enough."""
    return [np.diff(record.t) for record in records if len(record) > 10]


def gap_length(steps: Floats) -> float:
    """Return the interval above which a pause between samples is a gap [s]."""
    kinds = _kinds(steps)
    return GAP * (float(np.median(steps)) if kinds is None else kinds[1])


def even(steps: Floats) -> bool:
    """Return whether nearly all samples are equally spaced."""
    low, high = np.quantile(steps, [0.05, 0.95])
    return bool(high < (1.0 + JITTER) * low)


def _kinds(steps: Floats) -> tuple[float, float, float] | None:
    """Return two usual intervals and the share of the longer one; None if there is only one.

    Intervals that are whole multiples of the usual one are missing rows, not another kind.
    """
    most, usual = _mode(np.sort(steps))
    apart = np.abs(np.log(steps / most)) > np.log(MIXED)
    if not apart.any():
        return None
    other, count = _mode(np.sort(steps[apart]))
    if count < SHARE * len(steps) or usual + count < BOTH * len(steps):
        return None
    short, slow = min(most, other), max(most, other)
    ratio = slow / short
    if ratio < MISSING and abs(ratio - round(ratio)) < WHOLE:
        return None
    return short, slow, float(np.mean(steps > np.sqrt(short * slow)))


def _mode(steps: Floats) -> tuple[float, int]:
    """Return the most frequent interval of a sorted array, and its count."""
    ends = np.searchsorted(steps, steps * (1.0 + KIND), side="right")
    counts = ends - np.arange(len(steps))
    k = int(np.argmax(counts))
    return float(np.median(steps[k : ends[k]])), int(counts[k])
