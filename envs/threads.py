"""Threads that share the work of a large batch."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

LEAST = 256
"""Episodes per thread: with fewer it takes longer to start the threads than to do their work."""


def cores() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads_for(num: int) -> int:
    """Return how many threads to use for a number of episodes."""
    return max(1, min(cores(), num // LEAST))


@cache
def pool() -> ThreadPoolExecutor:
    """Return the threads of this process, which wait until there is work."""
    return ThreadPoolExecutor(cores(), thread_name_prefix="cjt_gym")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=pool.cache_clear)  # threads do not survive a fork


def side_by_side(function: Callable[..., int], shares: Sequence[tuple[Any, ...]]) -> int:
    """Call a function that releases the lock once per share; return the sum of what it returns."""
    others = [pool().submit(function, *share) for share in shares[1:]]
    return function(*shares[0]) + sum(other.result() for other in others)
