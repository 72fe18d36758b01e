"""Which rows of the effect table a record calls for: forward, then each left out again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fit import Fit, Problem
from cjt_gym.gap.horizons.found import Found, Held, worths_of
from cjt_gym.gap.horizons.grow import beyond, extend, is_needed, leaves, priced
from cjt_gym.gap.horizons.model import Model, Term
from cjt_gym.gap.horizons.rivals import ALIKE, FIRST, rivals_of
from cjt_gym.gap.horizons.starts import apart, begin, best_start, inverse_starts, seeded
from cjt_gym.gap.horizons.worth import worth

PATIENCE = 100_000_000
"""Predicted samples, a minute's work or two, after which nothing else is looked for."""
MOST = 6
"""Most terms beyond the base."""
SWAPS = 2
"""How often one term may take the place of another in the end."""
LATE, EDGE = "late", 0.02
"""Family of delays and lags, and how near to its bound, relative, one is at it."""


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
        return priced(fit, first) + held(fit)

    first = best_start(problem, base)
    dry = [term for term in terms if term.name == FIRST]
    begun = [first, *(begin(problem, first, term) for term in dry)]
    begun.append(seeded(problem, first, terms, suspects))
    if problem.force:
        begun += inverse_starts(problem, base, terms)
        chosen = apart(begun, first)
    else:
        chosen = [min(begun, key=lambda fit: priced(fit, first))]
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
