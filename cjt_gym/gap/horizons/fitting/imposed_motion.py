"""Motion that something else than the torque imposes: a joint that the torque hardly moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.prediction.model import Model
from cjt_gym.gap.horizons.prediction.windows import HORIZONS, relative
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.gap.recorded.tolerances import GUESSED

HEAVIER = (10.0, 1e3, 1e5)
"""Factors on the inertia for additional starts where nothing else predicts the motion."""
AT_ALL = 1.02
"""Relative error from which a joint predicts worse than motion at constant speed."""


def freed_from(problem: Problem, test: Problem, fits: Sequence[Fit]) -> Fit:
    """Return the best fit from given fits or heavier joints, as far as held-out data allow.

    Where the torque does not predict the motion, as when something else imposes it, a joint that
    the torque hardly moves has the least error. A guessed inertia does not prevent this.
    """
    first, values = fits[0].model.terms[0], fits[0].model.values(fits[0].z)[0]
    number = first.numbers[0]
    bound = replace(number, high=HEAVIER[-1] * number.high)
    guess = number.scale >= GUESSED
    model = _with_inertia(fits[0].model, replace(bound, prior=False) if guess else number)
    starts = [(fit.model, fit.z) for fit in fits]
    for factor in HEAVIER:
        z = fits[0].z.copy()
        z[0] = (bound if guess else number).coordinate(factor * values[0])
        starts.append((model, z))
    tried = side_by_side(lambda start: problem.fit(*start), starts)
    best = min(tried, key=lambda fit: fit.cost)
    if _astray(test, test.scored(best)):
        model, z = starts[-1]
        errors = problem.errors(model, z)
        unmoved = Fit(model, z, problem.cost(model, z, errors), errors)
        best = min([*tried, unmoved], key=lambda fit: test.scored(fit).cost)
    return replace(best, model=_with_inertia(best.model, bound)) if best.model is model else best


def _astray(test: Problem, fit: Fit) -> bool:
    """Return whether a fit predicts held-out motion worse than motion at constant speed."""
    errors = relative(test.windows, fit.errors)
    return any(e > AT_ALL for key, e in errors.items() if key[1] != min(HORIZONS))


def _with_inertia(model: Model, number: Number) -> Model:
    """Return a model whose first term, the inertia, has another number."""
    first = replace(model.terms[0], numbers=(number,))
    return replace(model, terms=(first, *model.terms[1:]))
