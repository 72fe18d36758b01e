"""The experiments that tell one effect from another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

SEPARATED_BY: dict[frozenset[str], str] = {
    frozenset(pair): text
    for *pair, text in (
        ("coulomb", "stribeck", "many slow reversals: ramps through zero velocity both ways"),
        ("coulomb", "presliding", "small oscillations inside the stuck region"),
        ("coulomb", "coulomb_asym", "slow ramps in both directions, and a rest without current"),
        ("coulomb", "torque_offset", "slow motion in both directions"),
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
        ("gravity", "contact", "slow motion over at least half a revolution"),
    )
}
NOTHING = "nothing"
"""Name of the model without a tentative effect."""
DEFAULT = "other excitation as well: slow ramps through zero, steps, and a chirp"
MOST_ADVICE = 2
"""Number of experiments told, and of remedies."""


def advice(name: str, rival: str) -> str:
    """Return which experiment separates two effects."""
    how = SEPARATED_BY.get(frozenset((name, rival)), DEFAULT)
    return f"To tell {difference(name, rival)}, record {how}."


def separating(alike: Mapping[str, Sequence[str]], remedies: Sequence[str] = ()) -> str:
    """Return which experiments separate effects from their rivals, and what to log better.

    Args:
        alike: Rivals of each effect.
        remedies: What to record instead, the most important first.
    """
    pairs: dict[frozenset[str], tuple[str, str]] = {}
    for name, rivals in alike.items():
        for rival in rivals:
            pairs.setdefault(frozenset((name, rival)), (name, rival))
    told: dict[str, list[str]] = {}
    for pair, (name, rival) in pairs.items():
        told.setdefault(SEPARATED_BY.get(pair, DEFAULT), []).append(difference(name, rival))
    said = [f"To tell {' and '.join(apart)}, record {how}." for how, apart in told.items()]
    return " ".join([*said[:MOST_ADVICE], *remedies[:MOST_ADVICE]])


def difference(name: str, *rivals: str) -> str:
    """Return the purpose of an experiment, as the end of a sentence that begins with "to tell"."""
    if rivals == (NOTHING,):
        return f"whether there is {name} at all"
    return f"{name} from {' and '.join(rivals)}"
