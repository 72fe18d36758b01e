"""Independent fits, side by side: the kernel that predicts lets the interpreter go on."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from threading import local
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")
Result = TypeVar("Result")
MOST = 8
"""Most threads; each spends a tenth of its time in the interpreter, where only one can be."""
_thread = local()


def side_by_side(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Return a function of each item, on as many threads as there are processors to use.

    What runs in one of them already goes on there, one item after the other.
    """
    items = list(items)
    count = min(len(items), _processors(), MOST)
    if count < 2 or getattr(_thread, "busy", False):
        return [function(item) for item in items]

    def run(item: Item) -> Result:
        _thread.busy = True
        with np.errstate(all="ignore"):  # a thread does not inherit it
            return function(item)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(run, items))


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
