"""Delays added by the bus and the control loop of a hardware record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cjt_gym.records import Record

LOOP = ("age", "lateness", "round_trip")
"""Columns that describe the control loop and are not channels of the joint."""
STAMPS: Mapping[str, str] = {
    "hardware": "by the clock of the interface",
    "kernel": "by the kernel",
    "interface": "by the interface",
    "reception": "where the program received them, so that what they waited there is missing",
}
"""Source of the frames' time stamps, by the record's `stamps`."""
SILENT = 0.01
"""Share of control steps without an answer above which it is reported."""


def bus(records: Sequence[Record]) -> list[str]:
    """Return sentences on the bus and loop of records that contain the loop columns."""
    found: dict[str, None] = {}
    for record in records:
        if all(name in record for name in LOOP):
            found |= dict.fromkeys(_sentences(record))
    return list(found)


def _sentences(record: Record) -> list[str]:
    age, late, trips = (record[name][np.isfinite(record[name])] for name in LOOP)
    answered = trips[trips > 0.0]
    if not (answered.size and age.size and late.size):
        return []
    middle, most = np.quantile(answered, [0.5, 0.99])
    way = min(0.5 * float(middle), record.dt)
    acts, seen = float(np.median(late)) + way, float(np.median(age)) + way
    stamps = STAMPS.get(str(record.provenance.get("stamps")))
    found = [
        f"A command is answered after {1e3 * middle:.3g} ms (99 %: {1e3 * most:.3g} ms)"
        + (f"; frames were stamped {stamps}." if stamps else "."),
        f"Bus and loop add {1e3 * acts:.3g} ms before a command acts and {1e3 * seen:.3g} ms to "
        f"what the controller sees: command_delay.delay={acts:.4g} "
        f"measurement_delay.delay={seen:.4g} for cjt-gym simulate --effect.",
    ]
    if (silent := 1.0 - answered.size / max(trips.size - 1, 1)) > SILENT:
        found.append(f"No answer came within {100.0 * silent:.2g} % of the control steps.")
    return found
