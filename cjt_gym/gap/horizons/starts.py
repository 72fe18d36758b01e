"""Starting points of the search for a model."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from cjt_gym.gap.horizons.fit import Fit, Problem
from cjt_gym.gap.horizons.grow import added, allowed, priced
from cjt_gym.gap.horizons.inverse import inverse
from cjt_gym.gap.horizons.model import Model, Term, motor_inertia
from cjt_gym.gap.horizons.side_by_side import side_by_side
from cjt_gym.gap.stages.number import Number

FAR = 0.5
"""Deviation of a logarithm at or above which other magnitudes are tried as starts, too."""
OTHER = 0.4
"""Difference of the logarithm of the inertia above which a second start is followed as well."""


def best_start(problem: Problem, model: Model) -> Fit:
    """Return the best fit of a model from a grid of starts for its numbers."""
    numbers = model.numbers
    grids = [_grid(n) for n in numbers]
    starts = [
        np.array([n.coordinate(v) for n, v in zip(numbers, values, strict=True)])
        for values in itertools.product(*grids)
    ]
    rough = problem.rough
    costs = side_by_side(lambda z: rough.cost(model, z, rough.errors(model, z)), starts)
    best = np.argsort(costs, kind="stable")[:2]
    return min(side_by_side(lambda k: problem.fit(model, starts[k]), best), key=lambda f: f.cost)


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


def apart(begun: Sequence[Fit], base: Fit) -> list[Fit]:
    """Return the best of some fits, and the best of those with a clearly different inertia."""
    ordered = sorted(begun, key=lambda fit: priced(fit, base))
    sizes = [float(np.log(fit.model.values(fit.z)[0][0])) for fit in ordered]
    others = [f for f, x in zip(ordered, sizes, strict=True) if abs(x - sizes[0]) > OTHER]
    return [ordered[0], *others[:1]]
