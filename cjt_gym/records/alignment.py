"""Logs whose rows hold values of different instants: each column moved to the row it belongs to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import ceil, floor

import numpy as np

from cjt_gym.errors import RecordError
from cjt_gym.records.checks import FloatArray

Columns = Mapping[str, FloatArray]


def aligned(
    pieces: Iterable[Columns], late: Mapping[str, float]
) -> Iterator[dict[str, FloatArray]]:
    """Yield the pieces of a log with late columns moved to earlier rows, early ones to later.

    Rows at either end of the log that lack one of the columns then are left out.
    """
    ahead = max((ceil(x) for x in late.values() if x > 0.0), default=0)
    behind = max((ceil(-x) for x in late.values() if x < 0.0), default=0)
    kept: dict[str, FloatArray] = {}
    some = False
    for piece in pieces:
        table = {n: np.concatenate([kept[n], x]) if kept else x for n, x in piece.items()}
        count = len(next(iter(table.values()), ())) - ahead - behind
        if not late or count > 0:
            some = True
            yield {n: _moved(x, late.get(n, 0.0), behind, count) for n, x in table.items()}
        kept = {n: x[max(count, 0) :] for n, x in table.items()} if late else {}
    if late and not some:
        raise RecordError(
            f"samples_late moves columns by up to {ahead + behind} rows, and the log has no more. "
            "Correct it, or take a longer log."
        )


def _moved(x: FloatArray, late: float, behind: int, count: int) -> FloatArray:
    """Return the rows of a column from one row on, moved; between rows it is interpolated."""
    first = behind + floor(late)
    share = late - floor(late)
    near = x[first : first + count]
    return near if share == 0.0 else (1.0 - share) * near + share * x[first + 1 :][:count]
