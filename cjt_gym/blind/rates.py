"""Shares with their intervals, and how well confidences keep their word."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

NORMAL: Final = 1.959964
BINS: Final = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Edges of the bins of confidence."""
DRAWS: Final = 2000


@dataclass(frozen=True)
class Rate:
    """A share of cases.

    Attributes:
        hits: Cases that count.
        total: All cases.
    """

    hits: int
    total: int

    @property
    def share(self) -> float | None:
        """Share of the hits; None where there is no case."""
        return self.hits / self.total if self.total else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share (Wilson, 1927, JASA 22); all of [0, 1] without a case."""
        if not self.total:
            return 0.0, 1.0
        n, p, z = self.total, self.hits / self.total, NORMAL
        middle = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max(middle - half, 0.0), min(middle + half, 1.0)

    def to_dict(self) -> dict[str, Any]:
        """Return counts, share and interval as plain values."""
        low, high = self.interval
        return {
            "hits": self.hits,
            "total": self.total,
            "share": self.share,
            "low": low,
            "high": high,
        }


def rate(hits: Iterable[bool]) -> Rate:
    """Return the share of what is true.

    Example:
        >>> rate([True, True, False]).to_dict()["hits"]
        2
    """
    values = list(hits)
    return Rate(sum(values), len(values))


def mean(values: Sequence[float]) -> dict[str, Any]:
    """Return a mean with its 95 % interval, by a bootstrap over the values."""
    if not len(values):
        return {"mean": None, "low": None, "high": None, "total": 0}
    array = np.asarray(values, dtype=np.float64)
    picks = np.random.default_rng(0).integers(0, len(array), (DRAWS, len(array)))
    low, high = np.quantile(array[picks].mean(axis=1), [0.025, 0.975])
    return {
        "mean": float(array.mean()),
        "low": float(low),
        "high": float(high),
        "total": len(array),
    }


def reliability(confidences: Sequence[float], right: Sequence[bool]) -> dict[str, Any]:
    """Return how often names were right, by how sure they were.

    Args:
        confidences: Of each name, in [0, 1].
        right: Whether it was right.

    Returns:
        `bins`, each with its edges, mean confidence, counts and the share that was right; `error`,
        the expected calibration error: the mean distance of the two, by counts; None without names.
    """
    at = np.minimum(np.digitize(confidences, BINS[1:-1]), len(BINS) - 2)
    bins, error = [], 0.0
    for k in range(len(BINS) - 1):
        inside = [n for n in range(len(at)) if at[n] == k]
        if not inside:
            continue
        share = Rate(sum(bool(right[n]) for n in inside), len(inside))
        confidence = float(np.mean([confidences[n] for n in inside]))
        error += len(inside) * abs(share.hits / share.total - confidence)
        bins.append(
            {"from": BINS[k], "to": BINS[k + 1], "confidence": confidence} | share.to_dict()
        )
    return {"bins": bins, "error": error / len(at) if len(at) else None, "total": len(at)}
