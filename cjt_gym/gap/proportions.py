"""Numbers over the torque constant, which a record knows better where it measures no torque.

All torques may then be larger in one ratio, which the tolerances of the datasheet alone limit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cjt_gym.gap.digits import plain
from cjt_gym.joint import JointFile

OVER_TORQUE: Mapping[str, str] = {
    "N m": "", "N": "",
    "kg m^2": " s^2/rad", "kg": " s^2/m",
    "N m/rad": "/rad", "N/m": "/m",
    "N m s/rad": " s/rad", "N s/m": " s/m",
}  # fmt: skip
"""Units that are in proportion to a torque or force, each with what is left of it over that."""
SHARPER, KNOWN = 0.5, 0.25
"""Ratio to its own relative deviation below which that of a proportion is told, and its largest."""
FEWEST = 2
NORMAL = 1.96


def proportions(joint: JointFile) -> str:
    """Return a sentence with the numbers of a joint over its torque constant, "" if none is better.

    Args:
        joint: The joint that was found, with the covariance of its numbers.
    """
    table: Any = joint.found.get("covariance", {})
    names = [str(name) for name in table.get("names", ())]
    scale = next((k for k, name in enumerate(names) if name.split(".")[-1] == "k_t"), None)
    p = joint.parameters
    if scale is None or "/" not in p.unit("k_t"):
        return ""
    values, matrix = (np.array(table[key], dtype=np.float64) for key in ("values", "matrix"))
    way = np.where(values == 0.0, np.inf, values)
    spread = matrix / np.outer(way, way)  # of the logarithms
    per = p.unit("k_t").split("/")[-1]
    told = []
    for k, name in enumerate(names):
        symbol = name.split(".")[-1]
        over = OVER_TORQUE.get(_unit(joint, name))
        own, known = math.sqrt(spread[k, k]), _deviation(spread, k, scale)
        if k != scale and over is not None and own > 0.0 and known < min(SHARPER * own, KNOWN):
            size = plain(values[k] / (values[scale] * p.get("n", 1.0)))
            told.append(f"{symbol} {size} {per}{over} ({_percent(known)})")
    if len(told) < FEWEST:
        return ""
    swing = _swing(names, values, spread)
    return f"Over k_t n these are known better than in themselves: {', '.join(told)}{swing}."


def _unit(joint: JointFile, name: str) -> str:
    """Return the unit of a number, "" if the joint does not have it."""
    effect, _, symbol = name.rpartition(".")
    rows = joint.effects.get(effect, {}) if effect else joint.parameters.quantities
    return getattr(rows.get(symbol), "unit", "")


def _deviation(spread: np.ndarray, one: int, other: int) -> float:
    """Return the relative deviation of a ratio of two numbers."""
    return math.sqrt(max(spread[one, one] + spread[other, other] - 2.0 * spread[one, other], 0.0))


def _percent(deviation: float) -> str:
    return f"± {plain(100.0 * NORMAL * deviation, 2)} %"


def _swing(names: Sequence[str], values: np.ndarray, spread: np.ndarray) -> str:
    """Return how fast the load swings on its spring if the motor is held, "" if that is unknown."""
    at = {name.split(".")[-1]: k for k, name in enumerate(names)}
    if not {"k_b", "I_l"} <= at.keys():
        return ""
    spring, load = at["k_b"], at["I_l"]
    frequency = math.sqrt(values[spring] / values[load]) / (2.0 * math.pi)
    known = 0.5 * _deviation(spread, spring, load)
    return f"; the load on its spring swings at {plain(frequency)} Hz ({_percent(known)})"
