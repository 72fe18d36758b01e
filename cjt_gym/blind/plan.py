"""Choices made for a blind case before its joint is drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cjt_gym.blind.excitation import DRAWN
from cjt_gym.blind.hidden import Effect
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plant import STRUCTURES, Structure
from cjt_gym.errors import ConfigurationError, check_name, check_range

SMALL: Final = 0.1
"""Strength of effects that are hard to see."""
STRUCTURE_SHARES: Final = {
    "output_fixed_rigid_gearbox": 0.3,
    "output_fixed": 0.15,
    "full_dynamics": 0.3,
    "rigid_gearbox": 0.15,
    "rigid": 0.1,
}
COUNTS: Final = {(0, 0): 0.14, (1, 0): 0.46, (2, 0): 0.22, (0, 1): 0.12, (1, 1): 0.06}
"""Probability of each number of effects of the table and outside it."""
ONE_OF: Final = frozenset({"coulomb", "coulomb_asym", "stribeck", "presliding", "load_coulomb"})
"""Kinds of dry friction, of which a joint has at most one."""
SAME: Final = (
    ({"coulomb", "coulomb_asym"}, {"torque_offset", "torque_bias"}),
    ({"torque_offset"}, {"torque_bias"}),
    ({"damping"}, {"viscous_asym"}),
    ({"noise"}, {"quantization"}),
)
"""Pairs equivalent to a single effect: Coulomb friction with a constant torque is asymmetric
Coulomb friction in any record."""


@dataclass(frozen=True)
class Plan:
    """Choices made for a case before its joint is drawn."""

    structure: Structure
    # effects of the table and outside it, with the place where each acts
    effects: tuple[tuple[Effect, str], ...]
    strength: float  # factor on their magnitudes
    excitations: tuple[str, str]  # kinds of excitation of the two records
    closed: tuple[bool, bool]  # whether the loop is closed in the two records
    duration: float  # of each record [s]
    defects: tuple[str, ...] = ()  # kinds of defects of the records, of DEFECTS


def draw_plan(
    effects: Iterable[str] | None,
    structure: str | None,
    excitation: str | None,
    closed_loop: bool | None,
    strength: float,
    duration: float,
    streams: Sequence[np.random.Generator],
) -> Plan:
    """Return a plan; None draws a choice at random.

    See `draw_case` for the arguments; the random numbers are those of the joint and of the records.
    """
    of_joint, of_records = streams
    _check(structure, excitation, strength, duration)
    named = None if effects is None else tuple(effects)
    form = _structure(structure, named, of_joint)
    return Plan(
        structure=form,
        effects=_effects(named, form, of_joint),
        strength=strength,
        excitations=_excitations(excitation, of_records),
        closed=_loops(closed_loop, of_records),
        duration=duration,
    )


def _check(structure: str | None, kind: str | None, strength: float, duration: float) -> None:
    if structure is not None:
        check_name("structure", structure, STRUCTURES)
    if kind is not None:
        check_name("excitation", kind, DRAWN)
    check_range("strength", strength, low=0.0, high=3.0)
    check_range("duration", duration, "s", low=2.0)


def _row(name: str) -> Effect:
    both = KNOWN | OUTSIDE
    check_name("effect", name, both)
    return both[name]


def _structure(
    structure: str | None, named: tuple[str, ...] | None, rng: np.random.Generator
) -> Structure:
    if structure is not None:
        return STRUCTURES[structure]
    rows = [(_row(name.split(":")[0]), name.partition(":")[2]) for name in named or ()]
    shares = {
        name: share
        for name, share in STRUCTURE_SHARES.items()
        if all(_can_have(effect, place, STRUCTURES[name]) for effect, place in rows)
    }
    if not shares:
        raise ConfigurationError(
            f"No structure can have the effects {', '.join(named or ())} together. "
            "Leave one of them out."
        )
    weights = np.array(list(shares.values()))
    return STRUCTURES[str(rng.choice(list(shares), p=weights / weights.sum()))]


def _can_have(effect: Effect, place: str, structure: Structure) -> bool:
    places = effect.places(structure)
    return place in places if place else bool(places)


def _effects(
    named: tuple[str, ...] | None, structure: Structure, rng: np.random.Generator
) -> tuple[tuple[Effect, str], ...]:
    names = _draw_names(structure, rng) if named is None else named
    found = []
    for name in names:
        kind, _, place = name.partition(":")
        effect = _row(kind)
        places = effect.places(structure)
        if not _can_have(effect, place, structure):
            raise ConfigurationError(
                f"A joint of structure {structure.name} cannot have the effect '{name}'. "
                f"Places there: {', '.join(filter(None, places)) or 'none'}."
            )
        found.append((effect, place or str(rng.choice(places))))
    return tuple(found)


def _draw_names(structure: Structure, rng: np.random.Generator) -> tuple[str, ...]:
    counts = list(COUNTS)
    known, outside = counts[int(rng.choice(len(counts), p=list(COUNTS.values())))]
    names = [n for n, effect in KNOWN.items() if effect.places(structure)]
    others = [n for n, effect in OUTSIDE.items() if effect.places(structure)]
    while True:
        drawn = [str(name) for name in rng.choice(names, known, replace=False)]
        if can_go_together(drawn):
            return (*drawn, *(str(name) for name in rng.choice(others, outside, replace=False)))


def can_go_together(names: Iterable[str]) -> bool:
    """Return whether effects differ from any smaller set of effects."""
    drawn = set(names)
    pairs = any(drawn & one and drawn & other for one, other in SAME)
    return len(ONE_OF & drawn) <= 1 and not pairs


def _excitations(kind: str | None, rng: np.random.Generator) -> tuple[str, str]:
    shares = np.array([0.4, 0.2, 0.1, 0.1, 0.1, 0.1])
    first = str(rng.choice(DRAWN, p=shares)) if kind is None else kind
    second = [name for name in ("composite", "multisine", "steps", "chirp") if name != first]
    return first, str(rng.choice(second))


def _loops(closed: bool | None, rng: np.random.Generator) -> tuple[bool, bool]:
    first, second = rng.random() < 0.2, rng.random() < 0.85
    return (bool(first) if closed is None else closed), bool(second)
