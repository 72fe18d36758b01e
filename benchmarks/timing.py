"""Timing on a machine that others use too: in turns, and the best of several rounds.

CPU time of the process counts, not that of the clock: what others do in between is not measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

ROUNDS = 5


def seconds(work: Callable[[], int]) -> tuple[float, float]:
    """Return time per unit of what `work` says that it did [s]: of the processors, of the clock."""
    began, begin = time.perf_counter(), time.process_time()
    units = work()
    return (time.process_time() - begin) / units, (time.perf_counter() - began) / units


def best_in_turns(works: Mapping[str, Callable[[], int]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the shortest CPU time per unit of each, all of them measured once per round [s].

    The first call of each, which compiles and fills caches, is not counted.
    """
    return {name: times[0] for name, times in both_in_turns(works, rounds).items()}


def both_in_turns(
    works: Mapping[str, Callable[[], int]], rounds: int = ROUNDS
) -> dict[str, tuple[float, float]]:
    """Return what `best_in_turns` does, and the same by the clock, where threads share work [s]."""
    for work in works.values():
        work()
    best = dict.fromkeys(works, (float("inf"), float("inf")))
    for _ in range(rounds):
        for name, work in works.items():
            cpu, clock = seconds(work)
            best[name] = (min(best[name][0], cpu), min(best[name][1], clock))
    return best
