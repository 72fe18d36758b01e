"""Result of a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.selection.stepwise import leaves
from cjt_gym.gap.horizons.selection.worth import Worth, worth

Held = Callable[[Fit], float]
"""Callable that returns the cost of a fit on held-out data."""


@dataclass(frozen=True)
class Found:
    """Result of a search.

    Attributes:
        fit: The model with all terms that the record supports.
        base: The fit of the base alone.
        worths: Worth of each term of the model.
        rivals: For each term, the names of others that would fit as well in its place.
        less: For each term, the fit without it.
        refuted: Terms that the fitted record shows and held-out data refute: names and values.
    """

    fit: Fit
    base: Fit
    worths: tuple[Worth, ...]
    rivals: tuple[tuple[str, ...], ...]
    less: tuple[Fit, ...]
    refuted: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def dropped(self, problem: Problem, index: int, held: Held) -> Found:
        """Return the result without one of its terms."""
        fit = self.less[index]
        less = tuple(leaves(problem, fit))
        rivals = self.rivals[:index] + self.rivals[index + 1 :]
        return Found(fit, self.base, worths_of(problem, less, fit, held), rivals, less)


def worths_of(problem: Problem, less: Sequence[Fit], fit: Fit, held: Held) -> tuple[Worth, ...]:
    """Return the worth of each term of a fit, given the fits without it."""
    kept = held(fit)
    return tuple(
        replace(worth(problem, one, fit, term), held=held(one) - kept)
        for one, term in zip(less, fit.model.terms, strict=True)
    )
