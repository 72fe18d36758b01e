"""Properties of each channel of a record: range, resolution, noise and missing samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cjt_gym.gap.check.balance import left_over
from cjt_gym.gap.check.clock import even
from cjt_gym.gap.recorded.noise import (
    MOST_JITTER,
    OTHER_ORDER,
    high_frequency_std,
    lattice_step,
    observed_jitter,
)
from cjt_gym.gap.recorded.series import slope
from cjt_gym.joint import JointFile
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import TRUE_PREFIX, Record

FEW_COUNTS = 100.0
"""Motion of an angle, in steps of its resolution, below which it hardly moves."""
ALIKE = 0.06
"""Relative difference up to which two noise estimates agree, so that the noise is white."""
FINEST = 1e-6
"""Least assumed noise of a channel, relative to its range."""
LATEST = 20
"""Largest delay, in samples, of a current after its command when estimating its noise."""


@dataclass(frozen=True)
class Channel:
    """One channel of a record."""

    name: str
    unit: str
    low: float  # smallest value
    high: float  # largest value
    # step of its values, the larger of that stated in the joint file and that observed; 0 if there
    # is neither
    resolution: float
    # standard deviation of a sample allowed by the joint file, or a whole step if it states only a
    # resolution; 0 if it states neither
    specified: float
    observed: float  # standard deviation observed in the samples; 0 if it cannot be determined
    unshaken: float  # the same without what grows with the slope, as of rows at uneven instants
    missing: float  # share of the samples that are missing

    @property
    def span(self) -> float:
        """Return the width of its range."""
        return self.high - self.low

    @property
    def noise(self) -> float:
        """Return the effective standard deviation of a sample, never zero."""
        is_step = math.isclose(self.specified, self.resolution, rel_tol=1e-3)
        known = self.observed or (0.0 if is_step else self.specified)
        return float(max(known, self.resolution / np.sqrt(12.0), FINEST * self.span, 1e-300))

    @property
    def moves(self) -> bool:
        """Whether the channel changes by more than noise and resolution."""
        return self.span > max(2.0 * self.resolution, 1e-12 * max(abs(self.high), abs(self.low)))

    def to_dict(self) -> dict[str, object]:
        """Return the channel as a JSON-serializable mapping."""
        return {
            "name": self.name,
            "unit": self.unit,
            "low": self.low + 0.0,  # no minus before a zero
            "high": self.high + 0.0,
            "resolution": self.resolution or None,
            "noise": self.observed if self.observed > FINEST * self.span else None,
            "missing": self.missing,
        }


def channels_of(records: Sequence[Record], joint: JointFile | None) -> dict[str, Channel]:
    """Return the channels that the longest record measured, with their ranges in all records.

    Noise and resolution are those of the longest record in which a channel changes.
    """
    ordered = sorted(records, key=len, reverse=True)
    found = {}
    for name in ordered[0].columns:
        own = [record for record in ordered if name in record and measured(name, record)]
        if own and own[0] is ordered[0]:
            values = [record[name][np.isfinite(record[name])] for record in own]
            at = next((k for k, x in enumerate(values) if np.ptp(x) > 0.0), 0)
            channel = _channel(own[at], joint, name, values[at])
            low, high = (float(f(np.concatenate(values))) for f in (np.min, np.max))
            found[name] = replace(channel, low=low, high=high)
    return found


def measured(name: str, record: Record) -> bool:
    """Return whether a column has samples from a sensor or controller."""
    ours = name != "t" and not name.startswith(TRUE_PREFIX)
    return ours and bool(np.isfinite(record[name]).any())


def _channel(record: Record, joint: JointFile | None, name: str, x: Floats) -> Channel:
    stated = joint.sensors.get(name, {}) if joint is not None else {}
    resolution = stated["resolution"].number if "resolution" in stated else 0.0
    noise = stated["noise"].number if "noise" in stated else 0.0
    observed = _observed(record, name, x)
    return Channel(
        name=name,
        unit=record.units[name],
        low=float(x.min()),
        high=float(x.max()),
        resolution=max(resolution, lattice_step(x)) if len(x) > 1 else resolution,
        specified=float(np.hypot(noise, resolution / np.sqrt(12.0))) if noise else resolution,
        observed=observed,
        unshaken=min(observed, _unshaken(x, float(np.median(np.diff(record.t))))),
        missing=1.0 - len(x) / len(record),
    )


def _observed(record: Record, name: str, x: Floats) -> float:
    """Return the standard deviation of white noise on a channel; 0 if it cannot be determined."""
    if name.endswith(("_cmd", "_ref")) or np.ptp(x) == 0.0:
        return 0.0
    beside = _beside_command(record) if name == "i" else 0.0
    if not even(np.diff(record.t)):
        return beside
    still = np.zeros(len(x))
    valid = np.ones(len(x), dtype=bool)
    first = high_frequency_std(x, valid, still)
    other = high_frequency_std(x, valid, still, OTHER_ORDER)
    if abs(first - other) <= ALIKE * first:
        return min(first, beside) if beside else first
    return beside


def _unshaken(x: Floats, dt: float) -> float:
    """Return the deviation of white noise that instants of sampling off their grid do not cause."""
    valid, steep = np.ones(len(x), dtype=bool), np.abs(slope(x, dt))
    shaken = observed_jitter(x, valid, steep, MOST_JITTER * dt) * steep
    return high_frequency_std(x, valid, shaken)


def _beside_command(record: Record) -> float:
    """Return the deviation of the current from its prediction by past commands; 0 if unknown."""
    if "i_cmd" not in record or len(record) < 50 * LATEST:
        return 0.0
    i, command = record["i"], record["i_cmd"]
    late = [np.roll(command, k) for k in range(LATEST + 1)]
    matrix = np.column_stack([np.roll(i, 1), *late, np.ones(len(i))])[LATEST:]
    y = i[LATEST:]
    good = np.isfinite(matrix).all(axis=1) & np.isfinite(y)
    if good.sum() < 50:
        return 0.0
    return left_over(y[good], list(matrix[good].T))
