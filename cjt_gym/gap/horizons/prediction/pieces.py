"""Pieces of records: what evidence is counted in, and what is fitted or held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cjt_gym.gap.horizons.prediction.log import Log

PIECES = 24
"""Number of pieces into which a record is cut; evidence must come from many of them."""
LEAST_PIECE = 0.8
"""Shortest piece [s]."""
HELD = 4
"""One in this many moving pieces is held out if there is no second record."""
FEWEST = 3
"""Fewest pieces that are held out; fewer would let one event judge a joint. Where 30 such records
were fitted whole, the errors on 45 others of the same joints were 14 % smaller."""
SHORTEST = 3
"""Fewest samples of a window."""


@dataclass(frozen=True)
class Piece:
    """A stretch of a record without a gap.

    Attributes:
        log: Index of the record.
        start: First sample.
        stop: Sample after the last.
    """

    log: int
    start: int
    stop: int


def cut(logs: Sequence[Log]) -> list[Piece]:
    """Return the pieces of records: about `PIECES` in each, none across a gap."""
    found = []
    for number, log in enumerate(logs):
        length = max(len(log) / PIECES, LEAST_PIECE / log.dt, 4 * SHORTEST)
        edges = np.flatnonzero(np.diff(np.r_[False, log.whole, False].astype(int)))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            count = max(int((stop - start) / length), 1)
            cuts = np.linspace(start, stop, count + 1).astype(int)
            found += [Piece(number, a, b) for a, b in pairwise(cuts.tolist())]
    return [p for p in found if p.stop - p.start >= 2 * SHORTEST]


def split(
    logs: Sequence[Log], pieces: Sequence[Piece], fewest: int = FEWEST
) -> tuple[list[Piece], list[Piece]]:
    """Return pieces to fit and pieces to hold out, the latter chosen from those with motion.

    Of a record with motion in few pieces, so that fewer than `fewest` would be, none is held out.
    """
    moved = [_motion(logs[p.log], p) for p in pieces]
    moving = [k for k, m in enumerate(moved) if m > 0.05 * max(moved)]
    held = set(moving[HELD // 2 :: HELD])
    held = held if len(held) >= fewest else set()
    return (
        [p for k, p in enumerate(pieces) if k not in held],
        [p for k, p in enumerate(pieces) if k in held],
    )


def _motion(log: Log, piece: Piece) -> float:
    """Return a measure of the motion in a piece, from the motor's speed or the torque."""
    cut = slice(piece.start, piece.stop)
    x = log.measured["tau"] if "tau" in log.measured and "q_m" not in log.measured else log.speed
    return float(np.std(x[cut]) + 0.1 * np.abs(np.mean(x[cut])))


def size_of(pieces: Sequence[Piece]) -> int:
    """Return how many samples pieces have."""
    return sum(p.stop - p.start for p in pieces)


def joined_up(pieces: Sequence[Piece]) -> list[Piece]:
    """Return pieces of one record, in order, with those joined that follow without a gap."""
    found: list[Piece] = []
    for p in pieces:
        if found and found[-1].stop == p.start:
            found[-1] = replace(found[-1], stop=p.stop)
        else:
            found.append(p)
    return found
