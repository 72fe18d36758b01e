"""Terms that would fit as well in the place of another."""

from __future__ import annotations

from collections.abc import Sequence

from cjt_gym.gap.horizons.fitting.fit import Fit, Problem
from cjt_gym.gap.horizons.prediction.model import Term
from cjt_gym.gap.horizons.selection.search_result import Found
from cjt_gym.gap.horizons.selection.stepwise import FULL, beyond, fully, looked_at, priced
from cjt_gym.gap.horizons.selection.worth import price
from cjt_gym.joint.effects import PACKAGED

FIRST = "coulomb"
"""Term tried from a grid of its own at the start, as damping alone may have taken its place."""
ALIKE, ALIKE_PLAIN = 2.0, 12.0
"""Cost difference up to which two models fit alike, and up to which plain dry friction still rivals
a law that refines it: a wrong input causes small differences between them."""
FEW = 2
"""Number of candidates, packaged ones included, that are fitted fully in the place of a term."""
REFINED = ("stribeck", "presliding", "coulomb_asym", "load_friction", "damping")
"""Laws of friction that refine or replace the plain one."""


def rivals_of(
    problem: Problem, found: Found, terms: Sequence[Term]
) -> tuple[tuple[tuple[str, ...], ...], Fit | None]:
    """Return for each term of a search result the names of others that could replace it.

    Also returned is the best fit with one term replaced, if clearly better: a law that was added
    first may block one that explains more together with others.
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
            gain = priced(fit, found.base) - priced(found.fit, found.base)
            if gain < best:
                better, best = fit, gain
    return tuple(rivals), better


def _in_its_place(
    problem: Problem, less: Fit, term: Term, others: Sequence[Term]
) -> list[tuple[Fit, Term, bool]]:
    """Return fits with others in place of a term, each with a flag for plain dry friction."""
    looked = looked_at(problem, less, others)
    own = [pair for pair in looked if pair[1].name not in PACKAGED][:FULL]
    plain = [pair for pair in looked if pair[1].name == FIRST] if term.name in REFINED else []
    chosen = {id(fit): (fit, t) for fit, t in (*looked[:FEW], *own, *plain[:1])}
    fitted = fully(problem, list(chosen.values()))
    return [(fit, t, bool(plain) and t.name == FIRST) for fit, t in fitted]
