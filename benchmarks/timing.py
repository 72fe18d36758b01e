"""Timing on a machine that others use too: in turns, over several rounds.

CPU time of the process counts, not that of the clock: what others do in between is not measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from statistics import median

ROUNDS = 5


def seconds(work: Callable[[], int]) -> tuple[float, float]:
    """Return time per unit of what `work` says that it did [s]: of the processors, of the clock."""
    began, begin = time.perf_counter(), time.process_time()
    units = work()
    return (time.process_time() - begin) / units, (time.perf_counter() - began) / units


def ratios(
    unit: Callable[[], int], works: Mapping[str, Callable[[], int]]
) -> dict[str, tuple[float, float]]:
    """Return how much less time each takes than a unit, by the processors and by the clock.

    The unit is measured before and after each, so that a machine that others slow down for a while
    slows down both; what is returned is the median of the rounds.
    """
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    for work in (unit, *works.values()):
        work()
    for _ in range(ROUNDS):
        for name, work in works.items():
            before, own, after = seconds(unit), seconds(work), seconds(unit)
            cpu, clock = (0.5 * (a + b) / c for a, b, c in zip(before, after, own, strict=True))
            found[name].append((cpu, clock))
    return {
        name: (median(cpu for cpu, _ in pairs), median(clock for _, clock in pairs))
        for name, pairs in found.items()
    }


def best_in_turns(works: Mapping[str, Callable[[], int]], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the shortest CPU time per unit of each, all of them measured once per round [s].

    The first call of each, which compiles and fills caches, is not counted.
    """
    for work in works.values():
        work()
    best = dict.fromkeys(works, float("inf"))
    for _ in range(rounds):
        for name, work in works.items():
            best[name] = min(best[name], seconds(work)[0])
    return best
