"""Selection of the effect-table rows that a record supports: forward search, then pruning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.prediction.model import Model, Term
from cjt_gym.gap.horizons.selection.rivals import ALIKE, FIRST, rivals_of
from cjt_gym.gap.horizons.selection.search_result import Found, Held, worths_of
from cjt_gym.gap.horizons.selection.starts import (
    afresh,
    apart,
    begin,
    best_start,
    inverse_starts,
    seeded,
)
from cjt_gym.gap.horizons.selection.stepwise import beyond, extend, is_needed, leaves, priced
from cjt_gym.gap.horizons.selection.worth import LOUDLY, Worth, worth

PATIENCE = 60_000_000
"""Number of predicted samples (half a minute of work or more) after which the search stops,
but for one replacement that is known to predict better."""
MOST = 6
"""Maximum number of terms that an extension adds."""
SWAPS = 2
"""Maximum number of final replacements of one term by another."""
WITHIN = 0.5
"""Rows up to which a dead time is none."""
LATE, WARM, EDGE = "late", "warm", 0.02
"""Families of delays and lags, and of heat, and the relative distance within which a value is at
its bound."""


def search(
    problem: Problem,
    base: Model,
    terms: Sequence[Term],
    suspects: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    tested: Callable[[Found], Found] = lambda found: found,
    held: Held = lambda _: 0.0,
) -> Found:
    """Return the terms that a record supports.

    Another weight than the listed one is tried early: without it, everything else would scale.
    Searches from different starts may end at different models. These are pruned in the order of
    their costs, which include held-out data, until no other could improve on the best.

    Args:
        problem: The windows.
        base: Model with the terms that are free in every fit.
        terms: Terms that may be added.
        suspects: Names of terms to start with, in order of importance.
        progress: Called with a description of the current step.
        tested: Removes terms refuted by held-out data from a search result.
        held: Returns the cost of a fit on held-out data.
    """
    until = problem.all_work + PATIENCE

    def total(fit: Fit) -> float:
        return priced(fit, first) + held(fit)

    def settled(end: Fit) -> Found:
        whole = pruned(problem, first, end, held)
        found = tested(whole)
        model, kept = whole.fit.model, {(t.key, t.tight) for t in found.fit.model.terms}
        pairs = zip(model.terms, model.values(whole.fit.z), strict=True)
        refuted.update({t.name: values for t, values in pairs if (t.key, t.tight) not in kept})
        return found

    refuted: dict[str, tuple[float, ...]] = {}
    first = best_start(problem, base)
    early = [t for t in terms if t.name == FIRST or (t.name == "gravity" and t.restated)]
    begun = [first, *(begin(problem, first, term) for term in early)]
    begun.append(seeded(problem, first, terms, suspects))
    if problem.windows.logs[0].voltage:  # its back-EMF makes up for damping
        begun += [afresh(problem, base, term) for term in terms if term.tight is not None]
    if problem.force:
        begun += inverse_starts(problem, base, terms)
        chosen = apart(begun, first)
    else:
        chosen = [min(begun, key=lambda fit: priced(fit, first))]
    ends = [*(extended(problem, fit, terms, progress, until, held) for fit in chosen), *begun]
    best, least = None, np.inf
    seen: list[set[tuple[tuple[str, str | None, str | None], bool]]] = []
    for cost, end in sorted(((total(fit), fit) for fit in ends), key=lambda pair: pair[0]):
        if least <= cost + ALIKE or (best is not None and problem.all_work > until):
            break
        if (kinds := {(t.key, t.tight is None) for t in end.model.terms}) in seen:
            continue  # the same terms, but from a worse start
        seen.append(kinds)
        found = settled(end)
        left = total(found.fit)
        if best is None or left < least:
            best, least = found, left
    assert best is not None
    for swap in range(SWAPS):
        rivals, better = rivals_of(problem, best, terms)
        best = replace(best, rivals=rivals)
        if better is None or (swap and problem.all_work > until):  # what is better is tried
            break
        end = extended(problem, better, terms, progress, until, held)
        found = settled(end)
        left = total(found.fit)
        if left > least - ALIKE:
            break
        best, least = found, left
    else:
        best = replace(best, rivals=rivals_of(problem, best, terms)[0])
    return replace(best, refuted=refuted)


def extended(
    problem: Problem,
    fit: Fit,
    terms: Sequence[Term],
    progress: Callable[[str], None],
    until: float = np.inf,
    held: Held = lambda _: 0.0,
) -> Fit:
    """Return a fit with terms added one by one as long as each gains more than its price.

    Args:
        problem: The windows.
        fit: The fit to extend.
        terms: Terms that may be added.
        progress: Called with a description of the current step.
        until: Number of predicted samples after which no further term is tried.
        held: Returns the cost of a fit on held-out data.
    """
    for _ in range(MOST):
        if problem.all_work > until:
            break
        progress(f"predicting up to half a second ahead with one of {len(terms)} effects more")
        step = next(
            (
                more
                for more, term in extend(problem, fit, terms)
                if _accepted(problem, fit, more, term, held)
            ),
            None,
        )
        if step is None:
            break
        fit = step
    return fit


def _accepted(problem: Problem, less: Fit, more: Fit, term: Term, held: Held) -> bool:
    """Return whether the record supports a further term, or held-out data do so loudly.

    A few pieces of a record may show a term that most of a held-out one shows. That is no reason
    to leave the datasheet.
    """
    own = next(k for k, t in enumerate(more.model.terms) if t.key == term.key)
    if _at_an_edge(problem, more, own):
        return False
    found = worth(problem, less, more, term)
    if found.fall > found.price and not found.enough and term.tight is None:
        gained = held(less) - held(more)
        found = replace(found, held=gained if gained > LOUDLY * found.price else 0.0)
    return found.enough and _is_seen_throughout(term, found)


def _is_seen_throughout(term: Term, found: Worth) -> bool:
    """Return whether heat shows in many pieces of its own record, for which no other can stand in.

    A motor is as warm in every record as its own past made it; one that weakens in another record
    as well, but not clearly in this one, may as well have friction that grows.
    """
    return term.family != WARM or found.clear > found.needed


def _at_an_edge(problem: Problem, fit: Fit, index: int) -> bool:
    """Return whether a term ends at a bound that means that it stands for something else.

    A delay or lag after a measured current is then slow mechanics; where only the command was
    recorded, the drive itself may be slow. Heat that fades as quickly as allowed is no heat, and a
    delay of less than half a row may as well be the instant at which rows are written.
    """
    term, values = fit.model.terms[index], fit.model.values(fit.z)[index]
    if term.family == WARM:
        quick = term.numbers[-1]
        return values[-1] < (1.0 + EDGE) * quick.low
    log = problem.windows.logs[0]
    if term.name == "command_delay" and values[0] < WITHIN * log.dt / log.rows:
        return True
    if log.drive != "i":
        return False
    return term.family == LATE and any(
        value < (1.0 + EDGE) * n.low if n.log else value > (1.0 - EDGE) * n.high
        for n, value in zip(term.numbers, values, strict=True)
    )


def pruned(problem: Problem, base: Fit, fit: Fit, held: Held) -> Found:
    """Return a search result without superfluous terms; rivals are not determined."""
    while True:
        less = leaves(problem, fit)
        if (nearer := _from_its_datasheet(problem, base, fit, less)) is not None:
            fit = nearer
            continue
        worths = worths_of(problem, less, fit, held)
        own = [k for k in beyond(base, fit) if not is_needed(fit, k)]
        weak = [
            k
            for k in own
            if not (worths[k].enough or worths[k].repeated)
            or not _is_seen_throughout(fit.model.terms[k], worths[k])
            or _at_an_edge(problem, fit, k)
        ]
        if not weak:
            return Found(fit, base, worths, ((),) * len(worths), tuple(less))
        fit = less[min(weak, key=lambda k: worths[k].fall)]


def _from_its_datasheet(problem: Problem, base: Fit, fit: Fit, less: Sequence[Fit]) -> Fit | None:
    """Return a better fit that starts with one base value reset to the datasheet, if any.

    A fit that started before all its terms were present may end far from it, at a higher cost.
    """
    fixed = [k for k in range(len(fit.model.terms)) if k not in beyond(base, fit)]
    worst = min(fixed, key=lambda k: less[k].cost, default=None)
    if worst is None or less[worst].cost > fit.cost - ALIKE:
        return None
    span = fit.model.span(worst)
    z = np.insert(less[worst].z, span.start, np.zeros(span.stop - span.start))
    new = problem.fit(fit.model, z)
    return new if new.cost < fit.cost - ALIKE else None
