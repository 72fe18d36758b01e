"""Adding a term to a model, or removing one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem, _solve, _within
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.horizons.selection.worth import price
from cjt_gym.gap.parallel import side_by_side
from cjt_gym.joint.kernel.arrays import Floats

FULL = 3
"""Number of candidates fitted fully after a quick look at all."""


BRISTLES = frozenset({"presliding", "spring_hysteresis"})
"""Laws with elastic elements that slip. Hardly any record tells two of them apart, and a joint that
has both takes ten times as long to simulate."""


def added(fit: Fit, term: Term, values: Sequence[float]) -> tuple[Model, Floats]:
    """Return a model with one more term, which may replace others, and its coordinates."""
    if term.tight is not None:
        return _freed(fit, term, values)
    kept = [k for k, t in enumerate(fit.model.terms) if t.name not in term.replaces]
    z = [fit.z[fit.model.span(k)] for k in kept]
    new = np.array([n.coordinate(v) for n, v in zip(term.numbers, values, strict=True)])
    terms = tuple(fit.model.terms[k] for k in kept)
    return replace(fit.model, terms=(*terms, term)), np.concatenate([*z, new])


def _freed(fit: Fit, term: Term, values: Sequence[float]) -> tuple[Model, Floats]:
    """Return a model with a datasheet value released from its tolerance, and its coordinates."""
    own = next(k for k, t in enumerate(fit.model.terms) if t.key == term.key)
    terms, z = list(fit.model.terms), fit.z.copy()
    pairs = zip(term.numbers, values, strict=True)
    terms[own], z[fit.model.span(own)] = term, [n.coordinate(v) for n, v in pairs]
    return replace(fit.model, terms=tuple(terms)), z


def quick(problem: Problem, fit: Fit, term: Term) -> Fit | None:
    """Return a rough fit with one more term: the best after one step from each of its starts."""
    best: Fit | None = None
    for start in term.starts:
        model, z = added(fit, term, start)
        errors = problem.errors(model, z)
        one = Fit(model, z, problem.cost(model, z, errors), errors)
        known = fit.jacobian if not _replaced(fit, term) else None
        stepped = _step(problem, one, len(fit.z) if known is not None else 0, known)
        if best is None or stepped.cost < best.cost:
            best = stepped
    return best


def _replaced(fit: Fit, term: Term) -> bool:
    return term.tight is not None or any(t.name in term.replaces for t in fit.model.terms)


def _step(problem: Problem, fit: Fit, first: int, known: Sequence[Floats] | None) -> Fit:
    """Return a fit after a damped step; derivatives of its first numbers may be known."""
    jacobian = problem.jacobian(fit.model, fit.z, fit.errors, first, known)
    hessian, gradient = problem.normal(fit.model, fit.z, fit.errors, jacobian)
    for damping in (1e-3, 0.3, 10.0):
        move = -_solve(hessian, damping, gradient)
        move *= min(1.0, 3.0 / max(float(np.abs(move).max()), 1e-12))
        z = _within(fit.model, fit.z + move)
        errors = problem.errors(fit.model, z)
        cost = problem.cost(fit.model, z, errors)
        if cost < fit.cost:
            return Fit(fit.model, z, cost, errors)
    return fit


def allowed(fit: Fit, term: Term) -> bool:
    """Return whether a term may be added to a model."""
    names = {t.name for t in fit.model.terms}
    same = [t for t in fit.model.terms if t.key == term.key]
    if same or term.tight is not None:
        return term.tight is not None and same == [term.tight]
    if term.name == "coulomb" and "coulomb_asym" in names:
        return False
    if term.name == "torque_offset" and names & {"gravity", "coulomb_asym", "viscous_asym"}:
        return False
    if term.name in BRISTLES and names & (BRISTLES - {term.name}):
        return False
    return not term.needs or bool((names | fit.model.joint.effects.keys()) & set(term.needs))


def extend(
    problem: Problem, fit: Fit, terms: Sequence[Term], most: int = FULL
) -> list[tuple[Fit, Term]]:
    """Return the fits with one more term, best first."""
    return fully(problem, looked_at(problem, fit, terms)[:most])


def looked_at(problem: Problem, fit: Fit, terms: Sequence[Term]) -> list[tuple[Fit, Term]]:
    """Return rough fits with one more term, best first."""
    rough = problem.rough
    here = rough.at(fit.model, fit.z)
    may = [t for t in terms if allowed(fit, t)]
    looked = zip(side_by_side(lambda t: quick(rough, here, t), may), may, strict=True)
    return sorted(((f, t) for f, t in looked if f is not None), key=lambda x: x[0].cost)


def fully(problem: Problem, rough: Sequence[tuple[Fit, Term]]) -> list[tuple[Fit, Term]]:
    """Return rough fits with one more term fitted to all windows, best first."""
    full = side_by_side(lambda x: (problem.fit(x[0].model, x[0].z), x[1]), rough)
    return sorted(full, key=lambda x: x[0].cost + price(x[1]))


def leaves(problem: Problem, fit: Fit) -> list[Fit]:
    """Return the fits without each of its terms."""
    return side_by_side(lambda k: leave(problem, fit, k), range(len(fit.model.terms)))


def leave(problem: Problem, fit: Fit, index: int) -> Fit:
    """Return the fit without one of its terms."""
    return problem.fit(*fit.model.without(index, fit.z))


def kept_near(problem: Problem, fit: Fit, index: int, tolerances: float) -> Fit:
    """Return the fit with a freed datasheet value at most so many tolerances off."""
    own = fit.model.terms[index]
    assert own.tight is not None
    number = own.numbers[0]
    reach = float(np.exp(tolerances * own.tight.numbers[0].scale))
    near = replace(number, low=number.start / reach, high=number.start * reach)
    terms, z = list(fit.model.terms), fit.z.copy()
    terms[index] = replace(own, numbers=(near,))
    at = fit.model.span(index).start
    z[at] = near.coordinate(number.value(float(z[at])))
    return problem.fit(replace(fit.model, terms=tuple(terms)), z)


def is_needed(fit: Fit, index: int) -> bool:
    """Return whether another term depends on this one."""
    own, *others = fit.model.terms[index], *fit.model.terms[:index], *fit.model.terms[index + 1 :]
    given = {t.name for t in others} | fit.model.joint.effects.keys()
    return any(own.name in t.needs and not given & set(t.needs) for t in others)


def beyond(base: Fit, fit: Fit) -> list[int]:
    """Return the indices of a fit's terms that its base lacks or holds within a tolerance."""
    given = {term.key for term in base.model.terms}
    terms = enumerate(fit.model.terms)
    return [k for k, t in terms if t.key not in given or t.tight is not None]


def priced(fit: Fit, base: Fit) -> float:
    """Return the cost of a fit plus the price of its terms beyond the base."""
    return fit.cost + sum(price(fit.model.terms[k]) for k in beyond(base, fit))
