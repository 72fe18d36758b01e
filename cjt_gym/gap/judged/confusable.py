"""Explanations that a record cannot tell apart."""

from __future__ import annotations

from cjt_gym.gap.stages.explain import Explanation
from cjt_gym.gap.stages.fit import Fit
from cjt_gym.gap.stages.merit import evidence
from cjt_gym.gap.stages.prune import SIMPLER

NEAR = 25.0
"""Difference in evidence within which another explanation counts as nearly as good."""
SHARE = 0.02
"""The same as a share of the evidence that speaks for the effect."""


def rival_fits(found: Explanation, index: int) -> dict[str, Fit]:
    """Return fits that replace one effect of an explanation by another, by its name, best first.

    A law that contains the effect as a special case and does no better is not a rival.
    """
    problem, effects = found.problem, found.fit.model.effects
    rest = {e.key for k, e in enumerate(effects) if k != index}
    own = evidence(problem, found.fit)
    limit = max(NEAR, SHARE * found.needs[index].evidence)
    richer = _richer(effects[index].name)
    fits: dict[str, Fit] = {}
    for other in sorted(found.seen, key=lambda f: -evidence(problem, f)):
        keys = {e.key for e in other.model.effects}
        extra = [e for e in other.model.effects if e.key not in rest]
        if len(extra) != 1 or effects[index].key in keys or len(rest - keys) > 1:
            continue
        name, behind = extra[0].name, own - evidence(problem, other)
        near = behind < limit and not extra[0].outside and not (name in richer and behind > 0.0)
        if near and name != effects[index].name:
            fits.setdefault(name, other)
    return fits


def _richer(name: str) -> set[str]:
    """Return the laws that contain an effect as a special case."""
    return {law for law, simpler in SIMPLER.items() if name in simpler}


def best_rival(found: Explanation, index: int) -> float:
    """Return the evidence of the best fit without one of the effects of an explanation.

    A law that contains the effect as a special case and does no better is not a rival.
    """
    problem, effect = found.problem, found.fit.model.effects[index]
    split = problem.stages.setting.current_unspecified and effect.name == "torque_offset"
    richer = _richer(effect.name)
    richer |= {"coulomb_asym", "viscous_asym"} if split else set()
    others = [
        evidence(problem, f)
        for f in found.seen
        if not any(
            (e.name == effect.name and e.body == effect.body) or e.name in richer
            for e in f.model.effects
        )
    ]
    return max(others, default=-1e9)
