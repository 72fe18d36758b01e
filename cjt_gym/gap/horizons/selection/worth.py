"""Worth of a model term: how much it lowers the cost of a fit, and how clearly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem, bounded
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.joint.kernel.arrays import Floats

PRICE, PER_NUMBER = 3.0, 1.0
"""Cost reduction required of a term, and of each of its numbers beyond the first."""
CLEAR = 2.5
"""Least cost reduction over the pieces of the record, in its own standard deviations."""
BROAD = 0.05
"""Share of the pieces, the best ones, without which a term must still lower the cost."""
LOUDLY = 5.0
"""Multiple of its price by which a term must lower the cost on held-out data where the fitted ones
hardly show it, or show it in few pieces only."""
QUIET = 0.2
"""Share of the usual error below which the error of a piece hardly matters."""


@dataclass(frozen=True)
class Worth:
    """Worth of a term.

    Attributes:
        fall: Reduction of the cost.
        clear: Reduction over the pieces of the record, in its own standard deviations.
        rest: Reduction without the best pieces.
        price: Required reduction.
        needed: Required clarity.
        strained: Whether it is a datasheet value beyond its tolerance.
        held: Reduction of the cost on held-out data, if evaluated.
    """

    fall: float
    clear: float
    rest: float
    price: float
    needed: float = CLEAR
    strained: bool = False
    held: float = 0.0

    @property
    def enough(self) -> bool:
        """Whether the record supports the term, clearly or confirmed by held-out data."""
        agreed = self.seen or self.strained
        return self.fall > self.price and agreed and self.broad

    @property
    def broad(self) -> bool:
        """Whether more than a few pieces show the term, or held-out data repeat it."""
        return self.rest > 0.3 * self.price or self.held > LOUDLY * self.price

    @property
    def repeated(self) -> bool:
        """Whether held-out data show the term loudly, and the fitted ones nothing against it."""
        return self.fall > -self.price and self.held > LOUDLY * self.price

    @property
    def seen(self) -> bool:
        """Whether errors support the term, and not only the datasheet."""
        return self.clear > self.needed or self.held > self.price


def price(term: Term) -> float:
    """Return the cost reduction required of a term."""
    return term.factor * (PRICE + PER_NUMBER * (len(term.numbers) - 1))


def worth(problem: Problem, less: Fit, more: Fit, term: Term) -> Worth:
    """Return the worth of a term from the fits without and with it.

    Errors of the pieces are also compared by their ratio, so that pieces with more motion do not
    count more; pieces without motion have hardly any weight.
    """
    size = max(int(problem.windows.pieces(k).max()) for k in problem.windows.keys) + 1
    gains, ratios, there = np.zeros(size), np.zeros(size), np.zeros(size, dtype=bool)
    for k, key in enumerate(problem.windows.keys):
        pieces, moving = problem.windows.pieces(key), problem.windows.moving[k]
        one, two = (
            np.bincount(pieces, bounded(fit.errors[k], moving)[0], size) for fit in (less, more)
        )
        count = np.bincount(pieces, problem.windows.roots(key) ** 2, size)
        there |= count > 0
        middle = float(np.sqrt(one.sum() * two.sum()))
        gains += problem.strength * problem.weight(key) * (one - two) / max(middle, 1e-12)
        quiet = QUIET * min(one.sum(), two.sum()) * count / count.sum() + 1e-12
        ratios += problem.weight(key) * np.log((one + quiet) / (two + quiet))
    gains, ratios = gains[there], ratios[there]
    best = np.sort(gains)[: len(gains) - max(round(BROAD * len(gains)), 1)]
    clear = max(_in_deviations(gains), _in_deviations(ratios))
    needed, fall, rest = CLEAR * term.factor**0.5, less.cost - more.cost, float(best.sum())
    strained = term.restated  # a datasheet value is held by priors, not by errors alone
    return Worth(fall, clear, fall if strained else rest, price(term), needed, strained)


def _in_deviations(x: Floats) -> float:
    """Return the sum of independent numbers in its own standard deviations."""
    n = len(x)
    deviation = float(np.std(x, ddof=1) * np.sqrt(n)) if n > 2 else np.inf
    return float(x.sum()) / max(deviation, 1e-12)
