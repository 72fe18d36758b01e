"""What a term of a model is worth: how much cheaper a fit is with it, and how clearly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.fit import Fit, Problem, bounded
from cjt_gym.gap.horizons.model import Term

Floats = NDArray[np.float64]
PRICE, PER_NUMBER = 3.0, 1.0
"""Fall of the cost that a term has to bring, and each of its numbers beyond the first."""
CLEAR = 2.5
"""Fall over the pieces of the record in its own standard deviations, at least."""
BROAD = 0.05
"""Share of the pieces, the best ones, without which a term must still be worth its price."""
QUIET = 0.2
"""Share of the usual error below which that of a piece makes no difference."""


@dataclass(frozen=True)
class Worth:
    """What a term is worth.

    Attributes:
        fall: By how much it lowers the cost.
        clear: That over the pieces of the record, in its own standard deviations.
        rest: Fall that is left without the best pieces.
        price: What it has to be worth.
        needed: How clear it has to be.
        strained: Whether it is a datasheet value beyond its tolerance.
        held: By how much it lowers the cost of held-out data, where these were asked.
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
        """Whether the record calls for it: clearly, or so that held-out data call for it, too."""
        agreed = self.seen or self.strained
        return self.fall > self.price and agreed and self.rest > 0.3 * self.price

    @property
    def seen(self) -> bool:
        """Whether errors show it, and not the datasheet alone."""
        return self.clear > self.needed or self.held > self.price


def price(term: Term) -> float:
    """Return what a term has to be worth."""
    return term.factor * (PRICE + PER_NUMBER * (len(term.numbers) - 1))


def worth(problem: Problem, less: Fit, more: Fit, term: Term) -> Worth:
    """Return what the difference between two fits is worth.

    Over the pieces the errors are compared by their ratio, so that no piece counts more because
    more happens in it; pieces in which nothing happens count for nothing.
    """
    size = max(int(problem.windows.pieces(k).max()) for k in problem.windows.keys) + 1
    gains, ratios, there = np.zeros(size), np.zeros(size), np.zeros(size, dtype=bool)
    for k, key in enumerate(problem.windows.keys):
        pieces, moving = problem.windows.pieces(key), problem.windows.moving[k]
        one, two = (
            np.bincount(pieces, bounded(fit.errors[k], moving)[0], size) for fit in (less, more)
        )
        count = np.bincount(pieces, minlength=size)
        there |= count > 0
        middle = float(np.sqrt(one.sum() * two.sum()))
        gains += problem.strength * problem.weight(key) * (one - two) / max(middle, 1e-12)
        quiet = QUIET * min(one.sum(), two.sum()) * count / count.sum() + 1e-12
        ratios += problem.weight(key) * np.log((one + quiet) / (two + quiet))
    gains, ratios = gains[there], ratios[there]
    best = np.sort(gains)[: len(gains) - max(round(BROAD * len(gains)), 1)]
    clear = max(_in_deviations(gains), _in_deviations(ratios))
    needed, fall, rest = CLEAR * term.factor**0.5, less.cost - more.cost, float(best.sum())
    strained = term.tight is not None  # what holds a datasheet value back is no error of a piece
    return Worth(fall, clear, fall if strained else rest, price(term), needed, strained)


def _in_deviations(x: Floats) -> float:
    """Return the sum of independent numbers in its own standard deviations."""
    n = len(x)
    deviation = float(np.std(x, ddof=1) * np.sqrt(n)) if n > 2 else np.inf
    return float(x.sum()) / max(deviation, 1e-12)
