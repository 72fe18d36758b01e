"""Merit of a model: the evidence for it, less the price of its effects."""

from __future__ import annotations

from cjt_gym.gap.stages.fit import Fit, Model, Problem

PRICE = 14.0
PRICE_PER_NUMBER = 3.0
RELEASE = 6.0
MARGIN = 3.0
"""Evidence that one more effect must add beyond its cost."""
LOG_SHARE = 0.08
"""Smallest log reduction of a stage's residual that an effect must achieve."""
STRAIN = 8.0
"""Alternatively, smallest relief of the datasheet's priors: four standard deviations."""


def price(model: Model) -> float:
    """Return the cost of a model's effects; one that only frees a datasheet value costs less."""
    return sum(
        (RELEASE if e.strained else PRICE) + PRICE_PER_NUMBER * (len(e.unknowns) - 1)
        for e in model.effects
    )


def evidence(problem: Problem, fit: Fit) -> float:
    """Return the deflated log evidence of a fit, minus the cost of its effects."""
    return -problem.cost(fit.model, fit.mean_square, fit.z, below=False) - price(fit.model)
