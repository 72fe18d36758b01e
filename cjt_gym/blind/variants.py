"""Records that are less orderly than usual, to see what a diagnosis makes of them."""

from __future__ import annotations

from typing import Final

import numpy as np

from cjt_gym.blind.plant import Floats

VARIANTS: Final = (
    "slow_sampling",
    "missing_channels",
    "dropped_rows",
    "stale_rows",
    "moving_start",
    "saturated",
    "long",
)
DISORDER: Final = 0.01
"""Share of rows that get lost or repeat the one before."""

MISSING: Final = (("i",), ("tau",), ("q_l",), ("i", "q_l"), ("i", "tau"), ("q_m",))
"""Channels that a record may lack."""

Columns = dict[str, Floats]


def drop_rows(columns: Columns, rng: np.random.Generator) -> Columns:
    """Return the record without some of its rows: single ones and a gap of 20."""
    samples = len(columns["t"])
    keep = rng.random(samples) >= DISORDER
    keep[0] = True
    gap = int(rng.integers(samples // 4, 3 * samples // 4))
    keep[gap : gap + 20] = False
    return {name: values[keep] for name, values in columns.items()}


def repeat_rows(columns: Columns, rng: np.random.Generator) -> Columns:
    """Return the record with some rows that repeat the one before, with their own time."""
    samples = len(columns["t"])
    source = np.arange(samples)
    stale = rng.random(samples) < DISORDER
    stale[0] = False
    source = np.maximum.accumulate(np.where(stale, 0, source))
    return {name: values if name == "t" else values[source] for name, values in columns.items()}


def without_channels(columns: Columns, rng: np.random.Generator) -> Columns:
    """Return the record without one or two of its measured channels."""
    gone = MISSING[int(rng.integers(len(MISSING)))]
    return {name: values for name, values in columns.items() if name not in gone}
