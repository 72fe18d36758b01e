"""From a record to arrays that the stages can use: evenly sampled, without gaps.

A sample that is missing (NaN), or that repeats the time of the one before, is filled by
interpolation and marked as not measured, so that no residual is taken from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import RecordError
from cjt_gym.joint import JointFile
from cjt_gym.records import Record

Floats = NDArray[np.float64]
USED = ("i_cmd", "i", "q_m", "q_g", "q_l", "tau", "tau_l")
SHORTEST = 200
"""Fewest samples from which anything can be told."""
UNEVEN = 0.2
"""Deviation of a sampling interval from the median, relative, above which times are re-sampled."""


@dataclass(frozen=True, eq=False)
class Series:
    """Evenly sampled channels.

    Attributes:
        dt: Sample time [s].
        columns: Channels by name, each of shape (N,), finite.
        valid: For each channel whether the sample was measured, shape (N,).
        zero: What was taken off each angle, so that it starts at zero [rad].
    """

    dt: float
    columns: Mapping[str, Floats]
    valid: Mapping[str, NDArray[np.bool_]]
    zero: Mapping[str, float]
    _speeds: dict[str, Floats] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Floats:
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def t(self) -> Floats:
        """Time from the first sample [s], shape (N,)."""
        return np.asarray(np.arange(len(self)) * self.dt, dtype=np.float64)

    def measured(self, *names: str) -> NDArray[np.bool_]:
        """Return where all the named channels were measured, shape (N,)."""
        good = np.ones(len(self), dtype=bool)
        for name in names:
            if name in self.valid:
                good &= self.valid[name]
        return good

    def speed(self, name: str) -> Floats:
        """Return the slope of a channel over four samples [unit/s], shape (N,)."""
        if name not in self._speeds:
            padded = np.pad(self.columns[name], 2, mode="edge")
            self._speeds[name] = np.asarray(
                (padded[4:] - padded[:-4]) / (4.0 * self.dt), dtype=np.float64
            )
        return self._speeds[name]

    def first_speed(self, name: str) -> float:
        """Return the slope of a channel over its first ten samples [unit/s]."""
        y = self.columns[name][:10]
        k = np.arange(len(y)) - 0.5 * (len(y) - 1)
        return float(k @ y / (k @ k) / self.dt)


def to_series(
    record: Record, joint: JointFile, zero_at: Mapping[str, float] | None = None
) -> Series:
    """Return the channels of a record on an even grid.

    Args:
        record: The record.
        joint: The joint, for the current that belongs to a torque.
        zero_at: What to take off each angle [rad]; left out, its first value.

    Raises:
        RecordError: The record is too short, has no motor angle, or nothing drives it.
    """
    columns = {name: record[name] for name in USED if name in record}
    _add_commands(columns, record, joint)
    columns = {name: x for name, x in columns.items() if np.isfinite(x).sum() > SHORTEST // 2}
    _check(record, columns)
    t, dt = record.t, float(np.median(np.diff(record.t)))
    even = np.abs(np.diff(t) - dt).max() <= UNEVEN * dt
    grid = t if even else t[0] + dt * np.arange(round((t[-1] - t[0]) / dt) + 1)
    out, valid, zero = {}, {}, {}
    for name, x in columns.items():
        good = np.isfinite(x)
        out[name] = x.copy() if good.all() and even else np.interp(grid, t[good], x[good])
        valid[name] = good if even else _near(grid, t[good], dt)
        if name.startswith("q_"):
            zero[name] = (zero_at or {}).get(name, float(out[name][0]))
            out[name] = out[name] - zero[name]
    return Series(dt, out, valid, zero)


def _near(grid: Floats, t: Floats, dt: float) -> NDArray[np.bool_]:
    """Return where a measured sample lies within half an interval of the grid."""
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    gap = np.minimum(np.abs(grid - t[after - 1]), np.abs(t[after] - grid))
    return np.asarray(gap <= 0.5 * dt)


def _add_commands(columns: dict[str, Floats], record: Record, joint: JointFile) -> None:
    """Turn torques of the motor into currents, where the currents are not there."""
    p = joint.parameters
    torques = {"i_cmd": "tau_cmd", "i": "tau_m"}
    for current, torque in torques.items():
        if current not in columns and torque in record:
            columns[current] = record[torque] / (p.k_t * p.n)


def _check(record: Record, columns: Mapping[str, Floats]) -> None:
    if len(record) < SHORTEST:
        raise RecordError(
            f"{record.owner} must have at least {SHORTEST} samples to be diagnosed, "
            f"got {len(record)}. Record for longer."
        )
    if "q_m" not in columns:
        raise RecordError(
            f"{record.owner} must have the motor angle q_m [rad] to be diagnosed. "
            f"Columns there: {', '.join(record.columns)}."
        )
    if "i" not in columns and "i_cmd" not in columns:
        raise RecordError(
            f"{record.owner} must have one of i [A], i_cmd [A], tau_m [N m] or tau_cmd [N m], "
            f"what drives the joint. Columns there: {', '.join(record.columns)}."
        )
