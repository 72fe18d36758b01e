"""What a blind test is made of: which effects its cases have.

Cases come in blocks of forty with fixed shares, in random order; single effects and effects outside
the table go through all rows before one comes again. So case 17 is the same however many there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from cjt_gym.blind.hidden import Effect
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plan import STRUCTURE_SHARES, can_go_together
from cjt_gym.blind.plant import STRUCTURES

BLOCK: Final = {"single": 22, "pair": 8, "none": 5, "outside": 3, "outside_and_known": 2}
"""Kinds of cases, and how many of forty there are."""


@dataclass(frozen=True)
class Recipe:
    """What one case is made of.

    Attributes:
        kind: One of BLOCK.
        seed: Seed of the case.
        effects: Names of its effects.
        structure: Name of its structure.
    """

    kind: str
    seed: int
    effects: tuple[str, ...]
    structure: str


def recipe(seed: int, index: int, structure: str | None = None) -> Recipe:
    """Return what a case of a test is made of.

    Args:
        seed: Seed of the test.
        index: Number of the case.
        structure: Structure of all cases; None draws it.
    """
    rng = np.random.default_rng((seed, index))
    kind = _order(seed, index // _size())[index % _size()]
    shapes = list(STRUCTURE_SHARES) if structure is None else [structure]
    effects: tuple[str, ...] = ()
    if kind == "single":
        effects = (_turn(seed, index, ("single",), KNOWN, shapes),)
    elif kind.startswith("outside"):
        effects = (_turn(seed, index, ("outside", "outside_and_known"), OUTSIDE, shapes),)
    shapes = [shape for shape in shapes if all(_fits(name, shape) for name in effects)]
    weights = np.array([STRUCTURE_SHARES[shape] for shape in shapes])
    shape = str(rng.choice(shapes, p=weights / weights.sum()))
    missing = {"pair": 2, "outside_and_known": 1}.get(kind, 0)
    names = [name for name in KNOWN if _fits(name, shape)]
    while missing:
        drawn = [str(name) for name in rng.choice(names, missing, replace=False)]
        if can_go_together((*drawn, *effects)):
            effects, missing = (*drawn, *effects), 0
    return Recipe(kind, int(rng.integers(2**53)), effects, shape)


def _size() -> int:
    return sum(BLOCK.values())


@cache
def _order(seed: int, block: int) -> tuple[str, ...]:
    """Return the kinds of the cases of a block."""
    kinds = [kind for kind, count in BLOCK.items() for _ in range(count)]
    return tuple(str(kind) for kind in np.random.default_rng((seed, block, 1)).permutation(kinds))


def _turn(
    seed: int, index: int, kinds: Sequence[str], table: dict[str, Effect], shapes: Sequence[str]
) -> str:
    """Return the row of a table whose turn it is at a case of one of these kinds."""
    names = sorted(name for name in table if any(_fits(name, shape) for shape in shapes))
    block, place = divmod(index, _size())
    before = block * sum(BLOCK[kind] for kind in kinds)
    turn = before + sum(kind in kinds for kind in _order(seed, block)[:place])
    again, which = divmod(turn, len(names))
    salt = len(kinds)
    return str(np.random.default_rng((seed, again, 2, salt)).permutation(names)[which])


def _fits(name: str, shape: str) -> bool:
    return bool((KNOWN | OUTSIDE)[name].places(STRUCTURES[shape]))
