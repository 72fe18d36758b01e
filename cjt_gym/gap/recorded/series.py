"""From a record to arrays that the stages can use: evenly sampled, without gaps.

A sample that is missing (NaN), or that repeats the time of the one before, is filled by
interpolation and marked as not measured, so that no residual is taken from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from cjt_gym.errors import RecordError
from cjt_gym.gap.recorded.fields import body_group
from cjt_gym.joint import JointFile, Structure
from cjt_gym.joint.kernel.arrays import Floats
from cjt_gym.records import Record

USED = ("i_cmd", "i", "q_m", "q_g", "q_l", "tau", "tau_l")
SHORTEST = 50
"""Minimum number of samples of a record. Several of 73 and 85, a second each from the buffers of
drives, told dry friction and damping as longer records did."""
ENOUGH, BRIEF, MOST = 500, 150, 8
"""Number of samples of a stretch that is worth having, of one that will do where a log has few of
them, as a fifth of it may be held out, and of such stretches of one log."""
SLOW = 4e-3
"""Sample time above which a log is slower than the control of any drive [s]."""
START = 0.01
"""Time over which the initial velocity is estimated [s]."""
UNEVEN = 0.2
"""Deviation of a sampling interval from the median, relative, above which times are re-sampled."""
ANGLES = ("q_m", "q_g", "q_l", "tau")
"""Channels smooth enough to show whether a record's time stamps can be trusted."""
STAMPED, ROW = 0.02, 0.5
"""Range of deviations from even time stamps, in samples, in which they are checked."""
TINY = 1e-300
HOLE = 5.0
"""Time between samples of a channel, in its median, from which the record is broken there."""


@dataclass(frozen=True, eq=False)
class Series:
    """Evenly sampled channels.

    Attributes:
        dt: Sample time [s].
        columns: Channels by name, each of shape (N,), finite.
        valid: For each channel whether the sample was measured, shape (N,).
        zero: Offset subtracted from each angle, so that it starts at zero [rad].
        derived: Channels that were not measured but follow from others and the nominal joint.
        past: Current from the beginning of the log up to the first sample [A], shape (M,); its
            rms where no current was recorded.
        rest: Number of samples from the last one to the end of the log.
    """

    dt: float
    columns: Mapping[str, Floats]
    valid: Mapping[str, NDArray[np.bool_]]
    zero: Mapping[str, float]
    derived: frozenset[str] = frozenset()
    past: Floats = field(default_factory=lambda: np.zeros(0))
    rest: int = 0
    _speeds: dict[str, Floats] = field(default_factory=dict)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Floats:
        return self.columns[name]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def slow(self) -> bool:
        """Whether the log is slower than the control of any drive."""
        return self.dt > SLOW

    @property
    def t(self) -> Floats:
        """Time from the first sample [s], shape (N,)."""
        return np.asarray(np.arange(len(self)) * self.dt, dtype=np.float64)

    @property
    def log_time(self) -> Floats:
        """Time from the beginning of the log [s], shape (N,)."""
        return self.t + len(self.past) * self.dt

    @property
    def log_length(self) -> float:
        """Duration of the log [s]."""
        return (len(self.past) + len(self) + self.rest) * self.dt

    def measured(self, *names: str) -> NDArray[np.bool_]:
        """Return whether all the named channels were measured at each sample, shape (N,)."""
        good = np.ones(len(self), dtype=bool)
        for name in names:
            if name in self.valid:
                good &= self.valid[name]
        return good

    def speed(self, name: str) -> Floats:
        """Return the slope of a channel over four samples [unit/s], shape (N,)."""
        if name not in self._speeds:
            self._speeds[name] = slope(self.columns[name], self.dt)
        return self._speeds[name]

    def change(self, name: str) -> Floats:
        """Return the larger change of a channel to its neighbours in time, shape (N,)."""
        steps = np.abs(np.diff(self.columns[name], prepend=self.columns[name][0]))
        return np.asarray(np.maximum(steps, np.append(steps[1:], 0.0)))

    def first_speed(self, name: str) -> float:
        """Return the slope of a channel at its first sample [unit/s].

        It is that of a parabola through the first samples: a cut log may begin in motion.
        """
        y = self.columns[name][: min(max(round(START / self.dt), 4), 20)]
        return float(np.polyfit(self.dt * np.arange(len(y)), y, 2)[1])


def slope(values: Floats, dt: float) -> Floats:
    """Return the slope of a channel over four samples of dt [s], shape (N,)."""
    padded = np.pad(values, 2, mode="edge")
    return np.asarray((padded[4:] - padded[:-4]) / (4.0 * dt), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Rows of a log in which no channel is lost for several samples.

    Attributes:
        record: The rows.
        log: The records that its log was read as, of which it is a part.
    """

    record: Record
    log: tuple[Record, ...] = ()

    def __len__(self) -> int:
        return len(self.record)

    def slice(self, start: int | None = None, stop: int | None = None) -> Stretch:
        """Return the rows from `start` up to but not including `stop`."""
        return Stretch(self.record.slice(start, stop), self.log)


def stretches(records: Sequence[Record]) -> list[Stretch]:
    """Return the stretches of records that are long enough, those of a log longest first.

    A predictor that has to guess what happened in a gap takes long to recover. Shorter stretches
    are taken where the others are less than half of a log, and brief ones only where all are.
    """
    found, seen = [], set[int]()
    for record in records:
        log = same_file(record, records)
        if id(log[0]) in seen:
            continue
        seen.add(id(log[0]))
        parts = [part for one in log for part in _unbroken(one)]
        parts.sort(key=len, reverse=True)
        enough = [part for part in parts if len(part) >= ENOUGH]
        if sum(map(len, enough)) < sum(map(len, log)) / 2:
            enough = [part for part in parts if len(part) >= BRIEF] or parts[:1]
        found += [Stretch(part, log) for part in enough[:MOST]]
    return [one for one in found if len(one) >= BRIEF] or found


def same_file(record: Record, records: Sequence[Record]) -> tuple[Record, ...]:
    """Return the records that were read from the same file as one of them, itself included."""
    origin = record.origin
    return tuple(r for r in records if r is record or (origin is not None and r.origin == origin))


def _unbroken(record: Record) -> list[Record]:
    """Return the stretches without a gap in which every channel of the record was measured."""
    t, edges = record.t, {0, len(record)}
    known = [np.isfinite(record[name]) for name in USED if name in record]
    known = [there for there in known if there.sum() >= SHORTEST]
    for there in map(np.flatnonzero, known):
        edges |= {int(there[0]), int(there[-1]) + 1}
        steps = np.diff(t[there])
        for k in np.flatnonzero(steps > HOLE * np.median(steps)):
            edges |= {int(there[k]) + 1, int(there[k + 1])}
    ends = [(a, b) for a, b in pairwise(sorted(edges)) if b - a >= SHORTEST]
    parts = [record.slice(a, b) for a, b in ends if all(there[a:b].any() for there in known)]
    return parts or [record]


def to_series(
    record: Record,
    joint: JointFile,
    structure: Structure,
    zero_at: Mapping[str, float] | None = None,
    log: Sequence[Record] = (),
) -> Series:
    """Return the channels of a record on an even grid.

    Args:
        record: The record.
        joint: The joint, for the current that belongs to a torque.
        structure: How its bodies are joined, for an angle that belongs to another.
        zero_at: Offset to subtract from each angle [rad]; by default its first value.
        log: Records of the same log, of which this one is a part.

    Raises:
        RecordError: The record is too short, has no motor angle, or nothing drives it.
    """
    columns = {name: record[name] for name in USED if name in record}
    _add_commands(columns, record, joint)
    columns = {name: x for name, x in columns.items() if np.isfinite(x).sum() >= SHORTEST}
    derived = _add_motor_angle(columns, record, joint, structure)
    _check(record, columns)
    t, dt = record.t, float(np.median(np.diff(record.t)))
    t = _stamped(columns, t, dt)
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
    ends = [float(one.t[-1]) for one in log]
    rest = max(round((max(ends, default=t[-1]) - float(t[-1])) / dt), 0)
    return Series(dt, out, valid, zero, derived, current_before(float(t[0]), log, joint, dt), rest)


def current_before(end: float, log: Sequence[Record], joint: JointFile, dt: float) -> Floats:
    """Return the current of a log before an instant [A], evenly sampled, shape (M,).

    Where rows are missing it is the rms of those before, which would heat as much.
    """
    times, currents = [np.zeros(0)], [np.zeros(0)]
    for record in log:
        columns = {name: record[name] for name in ("i_cmd", "i") if name in record}
        _add_commands(columns, record, joint)
        nothing = np.full(len(record), np.nan)
        current = columns.get("i", columns.get("i_cmd", nothing))
        known = np.isfinite(current) & (record.t < end - 0.5 * dt)
        times.append(record.t[known])
        currents.append(current[known])
    t, current = np.concatenate(times), np.concatenate(currents)
    if len(t) == 0:
        return current
    order = np.argsort(t)
    t, current = t[order], current[order]
    grid = end - dt * np.arange(round((end - t[0]) / dt), 0, -1)
    usual = float(np.sqrt(np.mean(current**2)))
    return np.where(_near(grid, t, 2.0 * dt), np.interp(grid, t, current), usual)


def _stamped(columns: dict[str, Floats], t: Floats, dt: float) -> Floats:
    """Resample measurements to even instants if the stamps can be trusted; return the times.

    Stamps may state when a sample was taken or when it was written: they are trusted if that
    makes the channels smoother. A current may jump: command and current keep their rows.
    """
    step = (t[-1] - t[0]) / (len(t) - 1)
    grid = t[0] + step * np.arange(len(t))
    late = np.abs(t - grid).max()
    if abs(step - dt) > ROW * dt or not STAMPED * dt < late < ROW * dt:
        return t
    smooth = {n: x for n, x in columns.items() if n in ANGLES and np.isfinite(x).all()}
    moved = {n: np.asarray(CubicSpline(t, x)(grid)) for n, x in smooth.items()}
    rough = [np.median(np.diff(y, 8) ** 2) for x in (smooth, moved) for y in x.values()]
    before, after = np.array(rough).reshape(2, -1) if smooth else (np.zeros(0), np.zeros(0))
    if np.sum(np.log((after + TINY) / (before + TINY))) < 0.0:
        columns |= moved
    return np.asarray(grid)


def _near(grid: Floats, t: Floats, dt: float) -> NDArray[np.bool_]:
    """Return whether a measured sample lies within half an interval of each grid point."""
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    gap = np.minimum(np.abs(grid - t[after - 1]), np.abs(t[after] - grid))
    return np.asarray(gap <= 0.5 * dt)


def _add_commands(columns: dict[str, Floats], record: Record, joint: JointFile) -> None:
    """Convert motor torques into currents if the currents are missing."""
    p = joint.parameters
    torques = {"i_cmd": "tau_cmd", "i": "tau_m"}
    for current, torque in torques.items():
        if current not in columns and torque in record:
            columns[current] = record[torque] / (p.k_t * p.n)


def _add_motor_angle(
    columns: dict[str, Floats], record: Record, joint: JointFile, structure: Structure
) -> frozenset[str]:
    """Add the motor's angle if it can be derived instead of measured; return what was added.

    It is the angle of a body that moves with the motor, or the integral of the motor's velocity,
    or, if the output is locked, the deflection that the joint torque causes in the spring.
    """
    if "q_m" in columns:
        return frozenset()
    moving = body_group(structure, "m")
    for body in moving:
        if f"q_{body}" in columns:
            columns["q_m"] = columns[f"q_{body}"]
            return frozenset()
    for name in (f"dq_{body}" for body in moving):
        if name in record and np.isfinite(record[name]).sum() >= SHORTEST:
            columns["q_m"] = _integral(record[name], record.t)
            return frozenset()
    p = joint.parameters
    if structure.output_fixed and "tau" in columns and p.get("k_b", 0.0) > 0.0:
        columns["q_m"] = columns["tau"] * compliance(joint, structure) + columns.get("q_l", 0.0)
        return frozenset({"q_m"})
    return frozenset()


def _integral(velocity: Floats, t: Floats) -> Floats:
    """Return the integral of a velocity over time, NaN where the velocity is missing."""
    good = np.isfinite(velocity)
    rate = np.interp(t, t[good], velocity[good])
    return np.where(good, cumulative_trapezoid(rate, t, initial=0.0), np.nan)


def compliance(joint: JointFile, structure: Structure) -> float:
    """Return the deflection between motor and load per joint torque [rad/(N m)]."""
    p = joint.parameters
    return 1.0 / p.k_b + (1.0 / p.k_g if structure.has_gear else 0.0)


def _filled(record: Record) -> str:
    """Return the names of columns with values, and of those with too few how many."""
    count = {name: int(np.isfinite(record[name]).sum()) for name in record.columns}
    few = {name: f" ({n} samples, too few)" for name, n in count.items() if n < SHORTEST}
    return ", ".join(f"{name}{few.get(name, '')}" for name, n in count.items() if n)


def _check(record: Record, columns: Mapping[str, Floats]) -> None:
    if len(record) < SHORTEST:
        raise RecordError(
            f"{record.owner} must have at least {SHORTEST} samples to be diagnosed, "
            f"beside what is held out for testing, got {len(record)}. Record for longer."
        )
    if "q_m" not in columns:
        raise RecordError(
            f"{record.owner} must have the motor angle q_m [rad] to be diagnosed: only with a held "
            "output can the joint torque tau [N m] stand in for it, by the stiffness k_b of the "
            f"joint. Columns with values: {_filled(record)}."
        )
    if "i" not in columns and "i_cmd" not in columns:
        if "v" in record:
            raise RecordError(
                f"{record.owner} has the voltage that drives the joint, but no current"
            )
        raise RecordError(
            f"{record.owner} must have one of i [A], i_cmd [A], tau_m [N m] or tau_cmd [N m], "
            f"what drives the joint. Columns with values: {_filled(record)}."
        )
