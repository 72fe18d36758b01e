"""Timing on a machine that others use too: in turns, and the best of several rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

ROUNDS = 5


def seconds(work: Callable[[], int]) -> float:
    """Return the time per unit of what `work` says that it did [s]."""
    begin = time.perf_counter()
    units = work()
    return (time.perf_counter() - begin) / units


def best_in_turns(works: Mapping[str, Callable[[], int]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the shortest time per unit of each, all of them measured once per round [s].

    The first call of each, which compiles and fills caches, is not counted.
    """
    for work in works.values():
        work()
    best = dict.fromkeys(works, float("inf"))
    for _ in range(rounds):
        for name, work in works.items():
            best[name] = min(best[name], seconds(work))
    return best
