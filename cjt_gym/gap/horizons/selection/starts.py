"""Starting points of the search for a model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from cjt_gym.gap.candidates.number import Number
from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.prediction.model import Model, Term, motor_inertia
from cjt_gym.gap.horizons.selection.stepwise import added, allowed, priced
from cjt_gym.gap.horizons.torque.inverse import inverse
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.joint.kernel.arrays import Floats

LARGEST = 400
"""Most starts of a grid that are all tried; several guesses in a datasheet make thousands."""
SWEEPS = 2
"""Number of times that each number of a larger grid is varied alone."""
FAR = 0.5
"""Deviation of a logarithm at or above which other magnitudes are tried as starts, too."""
OTHER = 0.4
"""Difference of the logarithm of the inertia above which a second start is followed as well."""


def best_start(problem: Problem, model: Model) -> Fit:
    """Return the best fit of a model from a grid of starts for its numbers.

    Of a grid that is too large, one number after the other is varied.
    """
    numbers = model.numbers
    grids = [np.array([n.coordinate(v) for v in _grid(n)]) for n in numbers]
    rough = problem.rough

    def cost(z: Floats) -> float:
        return rough.cost(model, z, rough.errors(model, z))

    if math.prod(map(len, grids)) <= LARGEST:
        starts = [np.array(z) for z in itertools.product(*grids)]
    else:
        starts = _one_by_one(cost, np.zeros(len(numbers)), grids)
    costs = side_by_side(cost, starts)
    best = np.argsort(costs, kind="stable")[:2]
    return min(side_by_side(lambda k: problem.fit(model, starts[k]), best), key=lambda f: f.cost)


def _one_by_one(
    cost: Callable[[Floats], float], z: Floats, grids: Sequence[Floats]
) -> list[Floats]:
    """Return the points that are best after each of `SWEEPS` through the numbers, last first."""
    found: list[Floats] = []
    for _ in range(SWEEPS):
        for k, grid in enumerate(grids):
            tried = [np.concatenate([z[:k], [x], z[k + 1 :]]) for x in grid]
            if len(tried) > 1:
                z = tried[int(np.argmin(side_by_side(cost, tried)))]
        found.insert(0, z)
    return found


def _grid(number: Number) -> tuple[float, ...]:
    """Return values of a number from which a fit may start."""
    if number.prior and number.scale < FAR:
        return (number.start,)
    if number.log:
        return tuple(number.value(np.log(k) / number.scale) for k in (0.1, 0.33, 1.0, 3.0, 10.0))
    return tuple(number.value(k) for k in (0.0, 2.0, 6.0, 15.0))


def seeded(problem: Problem, fit: Fit, terms: Sequence[Term], suspects: Sequence[str]) -> Fit:
    """Return a fit with the suspected terms, as far as they are compatible."""
    for name in suspects:
        term = next((t for t in terms if t.name == name and allowed(fit, t)), None)
        if term is not None and term.starts:
            model, z = added(fit, term, term.starts[0])
            fit = problem.fit(model, z)
    return fit


def inverse_starts(problem: Problem, base: Model, terms: Sequence[Term]) -> list[Fit]:
    """Return fits that start from regressions of the torque on the motion."""
    total, found = motor_inertia(base.joint), []
    for start in inverse(base.joint, problem.windows.logs):
        known = {"inertia": start.inertia / total, "damping": start.damping}
        z = [n.coordinate(known.get(t.name, n.start)) for t in base.terms for n in t.numbers]
        fit = Fit(base, np.array(z), np.inf, [])
        for name, values in start.effects.items():
            term = next((t for t in terms if t.name == name), None)
            if term is not None and allowed(fit, term):
                fit = Fit(*added(fit, term, values), np.inf, [])
        found.append(problem.fit(fit.model, fit.z))
    return found


def begin(problem: Problem, fit: Fit, term: Term) -> Fit:
    """Return the best fit with one more term, from a grid of all numbers."""
    model, _ = added(fit, term, term.starts[0])
    return best_start(problem, model)


def afresh(problem: Problem, base: Model, term: Term) -> Fit:
    """Return a fit with a freed datasheet value that starts with all others at the datasheet's.

    Once several values share what one of them lacks, no step leads back.
    """
    z = np.array([n.coordinate(n.start) for t in base.terms for n in t.numbers])
    model, z = added(Fit(base, z, np.inf, []), term, term.nominal)
    return problem.fit(model, z)


def apart(begun: Sequence[Fit], base: Fit) -> list[Fit]:
    """Return the best of some fits, and the best of those with a clearly different inertia."""
    ordered = sorted(begun, key=lambda fit: priced(fit, base))
    sizes = [float(np.log(fit.model.values(fit.z)[0][0])) for fit in ordered]
    others = [f for f, x in zip(ordered, sizes, strict=True) if abs(x - sizes[0]) > OTHER]
    return [ordered[0], *others[:1]]
