"""Rates with their intervals, and the calibration of confidences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from scipy.stats import binomtest

BINS: Final = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Edges of the bins of confidence."""
DRAWS: Final = 2000


def rate(hits: Iterable[bool]) -> dict[str, Any]:
    """Return the counts and the share of true values, with a 95 % interval (Wilson, 1927, JASA 22).

    Without cases the share is None and the interval is all of [0, 1].

    Example:
        >>> rate([True, True, False])["hits"]
        2
    """
    values = list(hits)
    n, count = len(values), sum(values)
    if not n:
        return {"hits": 0, "total": 0, "share": None, "low": 0.0, "high": 1.0}
    low, high = binomtest(count, n).proportion_ci(0.95, "wilson")
    ends = {"low": float(low), "high": float(high)}
    return {"hits": count, "total": n, "share": count / n} | ends


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
    """Return how often names were right, by confidence.

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
        share = rate(bool(right[n]) for n in inside)
        confidence = float(np.mean([confidences[n] for n in inside]))
        error += len(inside) * abs(share["share"] - confidence)
        bins.append({"from": BINS[k], "to": BINS[k + 1], "confidence": confidence} | share)
    return {"bins": bins, "error": error / len(at) if len(at) else None, "total": len(at)}
