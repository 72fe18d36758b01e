"""Timing on a machine that others use too: in turns, and the best of several rounds.

CPU time of the process counts, not that of the clock: what others do in between is not measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

ROUNDS = 5


def seconds(work: Callable[[], int]) -> float:
    """Return the CPU time per unit of what `work` says that it did [s]."""
    begin = time.process_time()
    units = work()
    return (time.process_time() - begin) / units


def best_in_turns(works: Mapping[str, Callable[[], int]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the shortest CPU time per unit of each, all of them measured once per round [s].

    The first call of each, which compiles and fills caches, is not counted.
    """
    for work in works.values():
        work()
    best = dict.fromkeys(works, float("inf"))
    for _ in range(rounds):
        for name, work in works.items():
            best[name] = min(best[name], seconds(work))
    return best
