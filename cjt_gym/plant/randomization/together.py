"""Numbers that a diagnosis found, drawn together as its covariance says."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cjt_gym.joint import EFFECTS, Joint
from cjt_gym.joint.files.diagnosed import covariance_of
from cjt_gym.plant.randomization.target import Domain, Target, find_target, variable_names
from cjt_gym.plant.randomization.variation import TAILS, Variation

SAME = 1e-6  # relative difference up to which a value is still the one that was found
LEAST = 0.05  # share of itself that a number keeps which must not become zero
WEAK = 1e-6  # weight below which a common score does not count
GROUP = "found"


def found_together(joint: Joint) -> dict[str, Variation]:
    """Return a normal variation of every number in the covariance that the joint's file states.

    Their normal scores mix common ones, so that the draws have that covariance up to where they
    are cut off: four standard deviations from the value, or the end of what the number may be.
    Numbers that do not act in this joint, or that have another value in it, are left out.
    """
    known = covariance_of(joint.file)
    if known is None:
        return {}
    names = variable_names(joint)
    std = np.sqrt(np.maximum(np.diag(known.matrix), 0.0))
    targets = {
        k: find_target(joint, name)
        for k, name in enumerate(known.names)
        if name in names and std[k] > 0.0 and _is_found(joint, name, float(known.values[k]))
    }
    kept = list(targets)
    mixtures = _mixtures(known.matrix[np.ix_(kept, kept)] / np.outer(std[kept], std[kept]))
    return {
        targets[k].name: _variation(targets[k], float(known.values[k]), float(std[k]), weights)
        for k, weights in zip(kept, mixtures, strict=True)
    }


def _variation(target: Target, mean: float, std: float, weights: dict[str, float]) -> Variation:
    low, high = _cut(target.domain, mean, TAILS * std)
    return Variation(
        low,
        high,
        "normal",
        "set",
        mean,
        std,
        group=tuple(weights),
        correlation=tuple(weights.values()),
    )


def _cut(domain: Domain, mean: float, half: float) -> tuple[float, float]:
    """Return mean - half and mean + half, within the domain."""
    least = LEAST * mean if domain.strict and domain.low >= 0.0 else domain.low
    return max(mean - half, least), min(mean + half, domain.high)


def _is_found(joint: Joint, name: str, value: float) -> bool:
    """Return whether a number of a joint is the one that was found."""
    effect, _, symbol = name.rpartition(".")
    if effect and symbol == "scale":
        file = joint.file.effects.get(effect, {})
        series = [p.symbol for p in EFFECTS[effect].parameters if p.series]
        return all(getattr(file.get(s), "value", None) == joint.effects[effect][s] for s in series)
    nominal = find_target(joint, name).nominal
    return math.isclose(nominal, value, rel_tol=SAME)


def _mixtures(correlation: NDArray[np.float64]) -> list[dict[str, float]]:
    """Return for each number the weights of common scores; their squares add up to 1.

    The first number has the first score alone, the second one the first two, and so on.
    """
    if not len(correlation):
        return []
    size, ways = np.linalg.eigh(correlation)
    root = ways * np.sqrt(np.maximum(size, 0.0))
    weights = np.asarray(np.linalg.qr(root.T, mode="r")).T
    weights *= np.where(np.diag(weights) < 0.0, -1.0, 1.0)
    weights[np.abs(weights) < WEAK] = 0.0
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    return [
        {f"{GROUP} {k + 1}": float(w) for k, w in enumerate(row) if w != 0.0} for row in weights
    ]
