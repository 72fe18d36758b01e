"""Which rows of the effect table a record calls for: forward, then each left out again."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cjt_gym.gap.horizons.fit import Fit, Problem, _solve, _within
from cjt_gym.gap.horizons.inverse import inverse
from cjt_gym.gap.horizons.model import Model, Number, Term, motor_inertia
from cjt_gym.gap.horizons.side_by_side import side_by_side
from cjt_gym.gap.horizons.worth import Worth, price, worth
from cjt_gym.joint.effects import PACKAGED

Floats = NDArray[np.float64]
Held = Callable[[Fit], float]
"""Returns the cost of a fit on held-out data."""
FULL = 3
"""Candidates that are fitted fully after a quick look at all."""
PATIENCE = 100_000_000
"""Predicted samples, a minute's work or two, after which nothing else is looked for."""
MOST = 6
"""Most terms beyond the base."""
OTHER = 0.4
"""Difference of the logarithm of the inertia from which a second start is followed as well."""
FIRST = "coulomb"
"""Dry friction is tried from a grid at once: damping alone may have taken its place."""
FAR = 0.5
"""Deviation of a logarithm from which a start is tried at other magnitudes, too."""
ALIKE, ALIKE_PLAIN = 2.0, 12.0
"""Difference of the cost up to which two models fit alike, and up to which plain dry friction is
still a rival of a law that refines it: a wrong input makes small differences between them."""
SWAPS = 2
"""How often one term may take the place of another in the end."""
LATE, EDGE = "late", 0.02
"""Family of delays and lags, and how near to its bound, relative, one is at it."""
REFINED = ("stribeck", "presliding", "coulomb_asym", "load_friction", "damping")
"""Laws of friction that refine the plain one, or take its place."""


@dataclass(frozen=True)
class Found:
    """What a search ends with.

    Attributes:
        fit: The model with all terms that the record calls for.
        base: The fit of the base alone.
        worths: Worth of each term of the model.
        rivals: For each term the names of others that would do as well in its place.
        less: For each term the fit without it.
    """

    fit: Fit
    base: Fit
    worths: tuple[Worth, ...]
    rivals: tuple[tuple[str, ...], ...]
    less: tuple[Fit, ...]

    def dropped(self, problem: Problem, index: int, held: Held) -> Found:
        """Return the search without one of its terms."""
        fit = self.less[index]
        less = tuple(leaves(problem, fit))
        rivals = self.rivals[:index] + self.rivals[index + 1 :]
        return Found(fit, self.base, worths_of(problem, less, fit, held), rivals, less)


def worths_of(problem: Problem, less: Sequence[Fit], fit: Fit, held: Held) -> tuple[Worth, ...]:
    """Return what each term of a fit is worth, given the fits without it."""
    kept = held(fit)
    return tuple(
        replace(worth(problem, one, fit, term), held=held(one) - kept)
        for one, term in zip(less, fit.model.terms, strict=True)
    )


def added(fit: Fit, term: Term, values: Sequence[float]) -> tuple[Model, Floats]:
    """Return a model with one more term, which may take the place of others, and coordinates."""
    if term.tight is not None:
        return _freed(fit, term, values)
    kept = [k for k, t in enumerate(fit.model.terms) if t.name not in term.replaces]
    z = [fit.z[fit.model.span(k)] for k in kept]
    new = np.array([n.coordinate(v) for n, v in zip(term.numbers, values, strict=True)])
    terms = tuple(fit.model.terms[k] for k in kept)
    return replace(fit.model, terms=(*terms, term)), np.concatenate([*z, new])


def _freed(fit: Fit, term: Term, values: Sequence[float]) -> tuple[Model, Floats]:
    """Return a model in which a datasheet value is free of its tolerance, and coordinates."""
    own = next(k for k, t in enumerate(fit.model.terms) if t.key == term.key)
    terms, z = list(fit.model.terms), fit.z.copy()
    pairs = zip(term.numbers, values, strict=True)
    terms[own], z[fit.model.span(own)] = term, [n.coordinate(v) for n, v in pairs]
    return replace(fit.model, terms=tuple(terms)), z


def quick(problem: Problem, fit: Fit, term: Term) -> Fit | None:
    """Return a rough fit with one more term: one step from each of its starts."""
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
    """Return a fit after a damped step, with the derivatives of its first numbers known."""
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
    if term.name == "viscous_asym" and "torque_offset" in names:
        return False
    return not term.needs or bool((names | fit.model.joint.effects.keys()) & set(term.needs))


def extend(
    problem: Problem, fit: Fit, terms: Sequence[Term], most: int = FULL
) -> list[tuple[Fit, Term]]:
    """Return the fits with one more term, the best first."""
    rough = problem.rough
    here = rough.at(fit.model, fit.z)
    may = [t for t in terms if allowed(fit, t)]
    looked = zip(side_by_side(lambda t: quick(rough, here, t), may), may, strict=True)
    best = sorted(((f, t) for f, t in looked if f is not None), key=lambda x: x[0].cost)
    full = side_by_side(lambda x: (problem.fit(x[0].model, x[0].z), x[1]), best[:most])
    return sorted(full, key=lambda x: x[0].cost + price(x[1]))


def search(
    problem: Problem,
    base: Model,
    terms: Sequence[Term],
    suspects: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    tested: Callable[[Found], Found] = lambda found: found,
    held: Held = lambda _: 0.0,
) -> Found:
    """Return the terms that a record calls for.

    Several searches from different starts may end at different models. They are pruned in the order
    of their costs, on held-out data, too, until no other could still be better than the best that
    is left.

    Args:
        problem: The windows.
        base: What is free in every fit.
        terms: What may be added.
        suspects: Names of terms to begin with, in the order of their weight.
        progress: Is told in words what is being done.
        tested: Takes out of a search's end what held-out data refute.
        held: Returns the cost of a fit on held-out data.
    """
    until = problem.all_work + PATIENCE

    def total(fit: Fit) -> float:
        return _priced(fit, first) + held(fit)

    first = best_start(problem, base)
    dry = [term for term in terms if term.name == FIRST]
    begun = [first, *(begin(problem, first, term) for term in dry)]
    begun.append(seeded(problem, first, terms, suspects))
    if problem.force:
        begun += inverse_starts(problem, base, terms)
        chosen = _apart(begun, first)
    else:
        chosen = [min(begun, key=lambda fit: _priced(fit, first))]
    ends = [*(extended(problem, fit, terms, progress, until) for fit in chosen), *begun]
    best, least = None, np.inf
    seen: list[set[tuple[tuple[str, str | None, str | None], bool]]] = []
    for cost, end in sorted(((total(fit), fit) for fit in ends), key=lambda pair: pair[0]):
        if least <= cost + ALIKE or (best is not None and problem.all_work > until):
            break
        if (kinds := {(t.key, t.tight is None) for t in end.model.terms}) in seen:
            continue  # the same terms, but from a worse start
        seen.append(kinds)
        found = tested(pruned(problem, first, end, held))
        left = total(found.fit)
        if best is None or left < least:
            best, least = found, left
    assert best is not None
    for _ in range(SWAPS):
        rivals, better = rivals_of(problem, best, terms)
        best = replace(best, rivals=rivals)
        if better is None or problem.all_work > until:
            break
        end = extended(problem, better, terms, progress, until)
        found = tested(pruned(problem, first, end, held))
        left = total(found.fit)
        if left > least - ALIKE:
            break
        best, least = found, left
    else:
        best = replace(best, rivals=rivals_of(problem, best, terms)[0])
    return best


def _priced(fit: Fit, base: Fit) -> float:
    """Return the cost of a fit with the price of its terms beyond the base."""
    return fit.cost + sum(price(fit.model.terms[k]) for k in beyond(base, fit))


def beyond(base: Fit, fit: Fit) -> list[int]:
    """Return which terms of a fit its base has not, or has within a datasheet's tolerance."""
    given = _keys(base)
    terms = enumerate(fit.model.terms)
    return [k for k, t in terms if t.key not in given or t.tight is not None]


def _apart(begun: Sequence[Fit], base: Fit) -> list[Fit]:
    """Return the best of some fits, and the best of those whose inertia is clearly different."""
    ordered = sorted(begun, key=lambda fit: _priced(fit, base))
    sizes = [float(np.log(fit.model.values(fit.z)[0][0])) for fit in ordered]
    others = [f for f, x in zip(ordered, sizes, strict=True) if abs(x - sizes[0]) > OTHER]
    return [ordered[0], *others[:1]]


def extended(
    problem: Problem,
    fit: Fit,
    terms: Sequence[Term],
    progress: Callable[[str], None],
    until: float = np.inf,
) -> Fit:
    """Return a fit with one term after another, as long as each is worth its price.

    Args:
        problem: The windows.
        fit: From where.
        terms: What may be added.
        progress: Is told in words what is being done.
        until: Predicted samples after which no further term is looked for.
    """
    for _ in range(MOST):
        if problem.all_work > until:
            break
        progress(f"predicting up to half a second ahead with one of {len(terms)} effects more")
        step = next(
            (
                more
                for more, term in extend(problem, fit, terms)
                if _accepted(problem, fit, more, term)
            ),
            None,
        )
        if step is None:
            break
        fit = step
    return fit


def best_start(problem: Problem, model: Model) -> Fit:
    """Return the best fit of a model from a grid of its numbers, which may be far off."""
    numbers = model.numbers
    grids = [_grid(n) for n in numbers]
    starts = [
        np.array([n.coordinate(v) for n, v in zip(numbers, values, strict=True)])
        for values in itertools.product(*grids)
    ]
    costs = side_by_side(lambda z: problem.cost(model, z, problem.errors(model, z)), starts)
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
    """Return a fit with the terms that others suspect, as far as they may stand together."""
    for name in suspects:
        term = next((t for t in terms if t.name == name and allowed(fit, t)), None)
        if term is not None and term.starts:
            model, z = added(fit, term, term.starts[0])
            fit = problem.fit(model, z)
    return fit


def inverse_starts(problem: Problem, base: Model, terms: Sequence[Term]) -> list[Fit]:
    """Return the fits that start from what a regression of the torque on the motion finds."""
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


def _accepted(problem: Problem, less: Fit, more: Fit, term: Term) -> bool:
    own = next(k for k, t in enumerate(more.model.terms) if t.key == term.key)
    return not _at_an_edge(problem, more, own) and worth(problem, less, more, term).enough


def _at_an_edge(problem: Problem, fit: Fit, index: int) -> bool:
    """Return whether a delay or lag is as long as any may be: something else is slow then.

    Where nothing but the command was recorded, what is slow may be the drive.
    """
    if problem.windows.logs[0].drive != "i":
        return False
    term, values = fit.model.terms[index], fit.model.values(fit.z)[index]
    return term.family == LATE and any(
        value < (1.0 + EDGE) * n.low if n.log else value > (1.0 - EDGE) * n.high
        for n, value in zip(term.numbers, values, strict=True)
    )


def pruned(problem: Problem, base: Fit, fit: Fit, held: Held) -> Found:
    """Return a search's end without the terms that are not needed; no rivals are looked for."""
    while True:
        less = leaves(problem, fit)
        if (nearer := _from_its_datasheet(problem, base, fit, less)) is not None:
            fit = nearer
            continue
        worths = worths_of(problem, less, fit, held)
        own = [k for k in beyond(base, fit) if not is_needed(fit, k)]
        weak = [k for k in own if not worths[k].enough or _at_an_edge(problem, fit, k)]
        if not weak:
            return Found(fit, base, worths, ((),) * len(worths), tuple(less))
        fit = less[min(weak, key=lambda k: worths[k].fall)]


def _from_its_datasheet(problem: Problem, base: Fit, fit: Fit, less: Sequence[Fit]) -> Fit | None:
    """Return a better fit from where a value that is always free is as in the datasheet.

    A fit may end far from it, and worse, where it began before it had all its terms.
    """
    fixed = [k for k in range(len(fit.model.terms)) if k not in beyond(base, fit)]
    worst = min(fixed, key=lambda k: less[k].cost, default=None)
    if worst is None or less[worst].cost > fit.cost - ALIKE:
        return None
    span = fit.model.span(worst)
    z = np.insert(less[worst].z, span.start, np.zeros(span.stop - span.start))
    new = problem.fit(fit.model, z)
    return new if new.cost < fit.cost - ALIKE else None


def is_needed(fit: Fit, index: int) -> bool:
    """Return whether another term makes no sense without one."""
    own, *others = fit.model.terms[index], *fit.model.terms[:index], *fit.model.terms[index + 1 :]
    given = {t.name for t in others} | fit.model.joint.effects.keys()
    return any(own.name in t.needs and not given & set(t.needs) for t in others)


def rivals_of(
    problem: Problem, found: Found, terms: Sequence[Term]
) -> tuple[tuple[tuple[str, ...], ...], Fit | None]:
    """Return for each term of a search's end the names of others that would do in its place.

    Beside them stands the best fit with one in another's place, where it is clearly better: a law
    that was taken first may stand in the way of one that explains more together with others.
    """
    new = beyond(found.base, found.fit)
    rivals: list[tuple[str, ...]] = []
    better, best = None, -ALIKE
    for k, term in enumerate(found.fit.model.terms):
        own = k in new
        if not (own or term.name in REFINED):
            rivals.append(())
            continue
        others = [t for t in terms if t.name != term.name and (own or t.name == FIRST)]
        fits = _in_its_place(problem, found.less[k], term, others)
        limit = found.fit.cost + price(term)
        near = [
            t.name
            for f, t, plain in fits
            if f.cost + price(t) < limit + (ALIKE_PLAIN if plain else ALIKE)
        ]
        rivals.append(tuple(dict.fromkeys(near)))
        for fit, _, _ in fits if own else ():
            gain = _priced(fit, found.base) - _priced(found.fit, found.base)
            if gain < best:
                better, best = fit, gain
    return tuple(rivals), better


def _keys(fit: Fit) -> set[tuple[str, str | None, str | None]]:
    return {t.key for t in fit.model.terms}


def leaves(problem: Problem, fit: Fit) -> list[Fit]:
    """Return the fits without each of its terms."""
    return side_by_side(lambda k: leave(problem, fit, k), range(len(fit.model.terms)))


def leave(problem: Problem, fit: Fit, index: int) -> Fit:
    """Return the fit without one of its terms."""
    return problem.fit(*fit.model.without(index, fit.z))


def _in_its_place(
    problem: Problem, less: Fit, term: Term, others: Sequence[Term]
) -> list[tuple[Fit, Term, bool]]:
    """Return the fits with others in the place of a term; marked is plain dry friction."""
    own = [t for t in others if t.name not in PACKAGED]
    plain = [t for t in others if t.name == FIRST] if term.name in REFINED else []
    looked = [*extend(problem, less, others, 2), *extend(problem, less, own)]
    simple = extend(problem, less, plain, 1)
    return [*((f, t, False) for f, t in looked), *((f, t, True) for f, t in simple)]
