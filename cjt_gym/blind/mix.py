"""Composition of a blind test: the effects of its cases.

Cases come in blocks of forty with fixed shares, in random order; single effects and effects outside
the table cycle through all rows. So case 17 is the same however many cases there are. With rough
logs every case has one defect in turn, and others at random; bare ones come with a datasheet that
states no more than most do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from cjt_gym.blind.defects import ROUGH
from cjt_gym.blind.hidden import Effect
from cjt_gym.blind.known import KNOWN
from cjt_gym.blind.outside import OUTSIDE
from cjt_gym.blind.plan import STRUCTURE_SHARES, can_go_together
from cjt_gym.blind.plant import STRUCTURES

BLOCKS: Final = {
    "clean": {"single": 22, "pair": 8, "none": 5, "outside": 3, "outside_and_known": 2},
    "rough": {"single": 16, "pair": 6, "none": 8, "outside": 3, "outside_and_known": 7},
    "bare": {"single": 22, "pair": 8, "none": 5, "outside": 3, "outside_and_known": 2},
}
"""Kinds of cases and their number among forty, by kind of logs."""
SIZE: Final = 40
"""Cases of a block."""
FURTHER: Final = 0.25
"""Probability of each further defect."""
OF_SENSORS: Final = ("noise", "quantization")
"""Effects that only a stated noise or resolution lets one see."""


@dataclass(frozen=True)
class Recipe:
    """Composition of one case: a kind of BLOCKS, and the arguments of `draw_case`."""

    kind: str
    seed: int
    effects: tuple[str, ...]
    structure: str
    defects: tuple[str, ...] = ()


def recipe(seed: int, index: int, structure: str | None = None, logs: str = "clean") -> Recipe:
    """Return the composition of a case of a test."""
    rng = np.random.default_rng((seed, index))
    known = {n: row for n, row in KNOWN.items() if logs != "bare" or n not in OF_SENSORS}
    kind = _order(seed, index // SIZE, logs)[index % SIZE]
    shapes = list(STRUCTURE_SHARES) if structure is None else [structure]
    effects: tuple[str, ...] = ()
    if kind == "single":
        effects = (_turn(seed, index, logs, ("single",), known, shapes),)
    elif kind.startswith("outside"):
        effects = (_turn(seed, index, logs, ("outside", "outside_and_known"), OUTSIDE, shapes),)
    shapes = [shape for shape in shapes if all(_fits(name, shape) for name in effects)]
    weights = np.array([STRUCTURE_SHARES[shape] for shape in shapes])
    shape = str(rng.choice(shapes, p=weights / weights.sum()))
    missing = {"pair": 2, "outside_and_known": 1}.get(kind, 0)
    names = [name for name in known if _fits(name, shape)]
    while missing:
        drawn = [str(name) for name in rng.choice(names, missing, replace=False)]
        if can_go_together((*drawn, *effects)):
            effects, missing = (*drawn, *effects), 0
    defects = _defects(seed, index) if logs == "rough" else ("bare",) if logs == "bare" else ()
    return Recipe(kind, int(rng.integers(2**53)), effects, shape, defects)


def _defects(seed: int, index: int) -> tuple[str, ...]:
    """Return the defects of the records of a case."""
    again, turn = divmod(index, len(ROUGH))
    first = np.random.default_rng((seed, again, 3)).permutation(ROUGH)[turn]
    more = np.random.default_rng((seed, index, 4)).random(len(ROUGH)) < FURTHER
    chosen = {str(first)} | {name for name, there in zip(ROUGH, more, strict=True) if there}
    if "command_only" in chosen:
        chosen.discard("missing")
    return tuple(name for name in ROUGH if name in chosen)


@cache
def _order(seed: int, block: int, logs: str) -> tuple[str, ...]:
    """Return the kinds of the cases of a block."""
    kinds = [kind for kind, count in BLOCKS[logs].items() for _ in range(count)]
    return tuple(str(kind) for kind in np.random.default_rng((seed, block, 1)).permutation(kinds))


def _turn(
    seed: int,
    index: int,
    logs: str,
    kinds: Sequence[str],
    table: dict[str, Effect],
    shapes: Sequence[str],
) -> str:
    """Return the row of a table that is next in turn at a case of one of these kinds."""
    names = sorted(name for name in table if any(_fits(name, shape) for shape in shapes))
    block, place = divmod(index, SIZE)
    before = block * sum(BLOCKS[logs][kind] for kind in kinds)
    turn = before + sum(kind in kinds for kind in _order(seed, block, logs)[:place])
    again, which = divmod(turn, len(names))
    salt = len(kinds)
    return str(np.random.default_rng((seed, again, 2, salt)).permutation(names)[which])


def _fits(name: str, shape: str) -> bool:
    return bool((KNOWN | OUTSIDE)[name].places(STRUCTURES[shape]))
