"""Explanations that a record cannot tell apart, and the experiment that would."""

from __future__ import annotations

from collections.abc import Sequence

from cjt_gym.gap.stages.fit import Fit, Problem
from cjt_gym.gap.stages.merit import evidence
from cjt_gym.gap.stages.prune import SIMPLER

NEAR = 25.0
"""Difference in evidence within which another explanation counts as nearly as good."""
SHARE = 0.02
"""The same as a share of the evidence that the explanation gained."""
SEPARATED_BY: dict[frozenset[str], str] = {
    frozenset(pair): text
    for *pair, text in (
        ("coulomb", "stribeck", "many slow reversals: ramps through zero velocity both ways"),
        ("coulomb", "presliding", "small oscillations inside the stuck region"),
        ("coulomb", "coulomb_asym", "slow ramps in both directions, and a rest without current"),
        ("stribeck", "presliding", "small oscillations inside the stuck region, then slow ramps"),
        ("presliding", "spring_hysteresis", "the torque of the spring, with a torque sensor"),
        ("coulomb", "load_friction", "the same slow motion under two different loads"),
        ("damping", "viscous_asym", "fast motion for the same time in both directions"),
        ("torque_bias", "torque_offset", "a rest at zero current with the spring relaxed"),
        ("torque_constant", "inertia", "a constant current held at rest, then a fast chirp"),
        ("torque_constant", "thermal_derating", "the same motion with the motor cold and warm"),
        ("torque_constant", "torque_gain", "a known weight, or a second torque reference"),
        ("stiffness", "torque_gain", "a known weight, or a second torque reference"),
        ("command_delay", "current_lag", "steps of different sizes in the command"),
        ("command_delay", "measurement_delay", "command and current on one clock, as a scope does"),
        ("cogging", "gear_ripple", "the same angles under different transmitted torques"),
        ("stiffness", "hardening", "small and large deflections of the spring"),
        ("stiffness", "backlash", "small deflections of the spring through zero"),
        ("gear_stiffness", "inertia", "excitation above the resonance of the gearbox"),
        ("damping", "coulomb", "constant velocities, slow and fast"),
    )
}
NOTHING = "nothing"
"""Name of the model without a tentative effect."""
DEFAULT = "a second record with other excitation: slow ramps through zero, steps, and a chirp"


def rival_fits(
    problem: Problem, base: Fit, fit: Fit, index: int, seen: Sequence[Fit]
) -> dict[str, Fit]:
    """Return fits that replace one effect of a fit by another, keyed by its name, best first.

    A law that contains the effect as a special case and does no better is not a rival.
    """
    effects = fit.model.effects
    rest = {e.key for k, e in enumerate(effects) if k != index}
    own = evidence(problem, fit)
    limit = max(NEAR, SHARE * (own - evidence(problem, base)))
    richer = _richer(effects[index].name)
    found: dict[str, Fit] = {}
    for other in sorted(seen, key=lambda f: -evidence(problem, f)):
        keys = {e.key for e in other.model.effects}
        extra = [e for e in other.model.effects if e.key not in rest]
        if len(extra) != 1 or effects[index].key in keys or len(rest - keys) > 1:
            continue
        name, behind = extra[0].name, own - evidence(problem, other)
        near = behind < limit and not extra[0].outside and not (name in richer and behind > 0.0)
        if near and name != effects[index].name:
            found.setdefault(name, other)
    return found


def _richer(name: str) -> set[str]:
    """Return the laws that contain an effect as a special case."""
    return {law for law, simpler in SIMPLER.items() if name in simpler}


def rivals(problem: Problem, base: Fit, fit: Fit, index: int, seen: Sequence[Fit]) -> list[str]:
    """Return effects that could replace one effect of a fit, best first."""
    return list(rival_fits(problem, base, fit, index, seen))


def best_rival(problem: Problem, fit: Fit, index: int, seen: Sequence[Fit]) -> float:
    """Return the evidence of the best fit without one of a model's effects.

    A law that contains the effect as a special case and does no better is not a rival.
    """
    effect = fit.model.effects[index]
    split = problem.stages.setting.current_unspecified and effect.name == "torque_offset"
    richer = _richer(effect.name)
    richer |= {"coulomb_asym", "viscous_asym"} if split else set()
    others = [
        evidence(problem, f)
        for f in seen
        if not any(
            (e.name == effect.name and e.body == effect.body) or e.name in richer
            for e in f.model.effects
        )
    ]
    return max(others, default=-1e9)


def advice(name: str, rival: str) -> str:
    """Return which experiment separates two effects."""
    how = SEPARATED_BY.get(frozenset((name, rival)), DEFAULT)
    return f"To tell {difference(name, rival)}, record {how}."


def difference(name: str, *rivals: str) -> str:
    """Return the purpose of an experiment, as the end of a sentence that begins with "to tell"."""
    if rivals == (NOTHING,):
        return f"whether there is {name} at all"
    return f"{name} from {' and '.join(rivals)}"
